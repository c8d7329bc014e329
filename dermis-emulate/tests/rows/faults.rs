//! The pipeline during faults of the instrument and after them.

use crate::rows::bench::{Bench, lab, place, stroke};
use crate::rows::gaps::until;
use dermis::pipeline::{InvalidReason, PipelineFrame, Settings, Validity};

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
