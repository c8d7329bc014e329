//! The pipeline during faults of the instrument and after them.

use crate::rows::bench::{Bench, lab, place, stroke};
use crate::rows::gaps::until;
use dermis::pipeline::{InvalidReason, PipelineFrame, Settings, Validity};
use dermis::stats::rms;
use dermis_sim::random::{sample_rng, standard_normal};
use rand::RngExt;

/// Asserts that frames say that nothing touches.
fn assert_untouched(frames: &[PipelineFrame]) {
    for frame in frames {
        assert_eq!(frame.validity, Validity::Ok, "frame {}", frame.sequence);
        assert_eq!((frame.touched, frame.contacts.len()), (Some(false), 0), "frame {}", frame.sequence);
    }
}

#[test]
fn a_press_on_an_electrode_that_comes_back_leaves_no_contact() {
    // Electrode 20 is at 240 mm, 0 degrees: while it is masked, no other channel sees a press there.
    let press = stroke(2.0, 1.0, place(0.24, 0.0), None, 0.3);
    let mut bench = Bench::faulty(lab(), 65, vec![press], Settings::default(), &["loose:20:1e6@1.2", "mend:20@2.2"]);
    let masked = until(&mut bench, 2.2);
    assert!(masked.iter().rev().take(20).all(|frame| frame.touched == Some(false)), "the press is hidden");
    until(&mut bench, 3.6);
    assert_untouched(&until(&mut bench, 8.0));
}

#[test]
fn an_offset_of_all_values_is_no_touch_and_ends() {
    let press = stroke(4.0, 1.0, place(0.15, 120.0), None, 2.0);
    let mut bench = Bench::faulty(lab(), 66, vec![press], Settings::default(), &["offset:40@2+1"]);
    assert_untouched(&until(&mut bench, 2.0));
    for (index, frame) in until(&mut bench, 3.0).into_iter().enumerate() {
        let Validity::Invalid { reason } = frame.validity else {
            panic!("frame {}: {}", frame.sequence, frame.validity)
        };
        // The jump to another value is large, too.
        assert!(reason == InvalidReason::Offset || index < 2, "frame {}: {reason:?}", frame.sequence);
        assert!(frame.touched.is_none() && frame.contacts.is_empty());
    }
    until(&mut bench, 3.3);
    assert_untouched(&until(&mut bench, 4.0));
    assert_eq!(until(&mut bench, 4.5).last().unwrap().contacts.len(), 1);
}

#[test]
fn values_in_the_place_of_others_after_the_tare_are_no_frames_of_the_skin() {
    for by in [1, 29, 435] {
        let mut bench =
            Bench::new(lab(), 68, vec![stroke(2.0, 1.0, place(0.15, 120.0), None, 2.0)], Settings::default());
        until(&mut bench, 1.5);
        let slipped: Vec<PipelineFrame> = (0..120).map(|_| bench.changed(|values| values.rotate_left(by))).collect();
        let usable = slipped.iter().filter(|frame| frame.validity.is_usable()).count();
        assert_eq!(usable, 0, "by {by}");
        until(&mut bench, 4.0);
        assert_untouched(&until(&mut bench, 4.5));
    }
}

/// Spikes of one frame on all values of a drive, or on as many others.
#[test]
fn spikes_of_a_frame_are_no_contacts() {
    let mut bench = Bench::new(lab(), 67, Vec::new(), Settings::default());
    let mut rng = sample_rng(67, 0);
    for (is_of_drive, size) in [true, false].into_iter().flat_map(|of| [0.01, 0.1, 1.0].map(|size| (of, size))) {
        for _ in 0..4 {
            let first = rng.random_range(0..30) * 29;
            let channels: Vec<usize> = (first..first + 29)
                .map(|channel| if is_of_drive { channel } else { rng.random_range(0..870) })
                .collect();
            for index in 0..12 {
                let frame = bench.changed(|values| {
                    if index == 0 {
                        let size = size * rms(values.iter().copied());
                        channels.iter().for_each(|&channel| values[channel] += size * standard_normal(&mut rng));
                    }
                });
                bench.rebuild();
                assert!(frame.contacts.is_empty(), "size {size}, of a drive: {is_of_drive}: {:?}", frame.contacts);
            }
        }
    }
}
