//! The device in conversation: answers in the order of the requests, rates, tables, slow lines, unplugging.

use crate::parts::{FakeFrontEnd, FakeLink, FakeSystem, INSTRUMENT, MAX, SLOTS, counts, with_device};
use dermis_firmware::{HardwareFault, Limits, Plan, Scanned, Scanner, SlotScanner, TimedSlot};
use dermis_wire::{FaultCode, FrameFlags, ScanPart, Slot, Slots, ToDevice, ToHost, test_reading};
use rand::{Rng, RngExt, SeedableRng};

/// Short names of messages.
fn kinds(messages: &[Vec<u8>]) -> Vec<String> {
    let name = |message: &Vec<u8>| match ToHost::parse(message).unwrap() {
        ToHost::Hello(hello) => format!("hello {} {}", hello.slot_count, hello.rate_millihertz),
        ToHost::Frame(frame) if frame.flags.has(FrameFlags::TEST) => "test".into(),
        ToHost::Frame(_) => "frame".into(),
        ToHost::Status(_) => "status".into(),
        ToHost::Fault(fault) => format!("fault {}", u8::from(fault.code)),
    };
    messages.iter().map(name).collect()
}

/// The numbers, times and flags of the frames among some messages.
fn frames(messages: &[Vec<u8>]) -> Vec<(u32, u64, u8)> {
    let frame = |message: &Vec<u8>| match ToHost::parse(message).unwrap() {
        ToHost::Frame(frame) => Some((frame.sequence, frame.time_us, frame.flags.bits())),
        _ => None,
    };
    messages.iter().filter_map(frame).collect()
}

/// The parts of a board and what the tests do with them.
struct Bench<'a> {
    device: dermis_firmware::Device<'a>,
    scanner: SlotScanner<'a, FakeFrontEnd>,
    link: FakeLink,
    system: FakeSystem,
}

impl Bench<'_> {
    /// Polls for a time in steps of 100 us.
    fn poll(&mut self, for_us: u64) {
        let end_us = self.system.now_us + for_us;
        while self.system.now_us < end_us {
            self.device.poll(&mut self.scanner, &mut self.link, &mut self.system);
            self.system.now_us += 100;
        }
    }

    /// Polls for a time and returns what the device has said.
    fn run(&mut self, for_us: u64) -> Vec<Vec<u8>> {
        self.poll(for_us);
        self.link.heard()
    }

    fn ask(&mut self, messages: &[ToDevice<'_>]) -> Vec<Vec<u8>> {
        messages.iter().for_each(|message| self.link.ask(message));
        self.run(5000)
    }
}

fn bench(instrument: dermis_firmware::Instrument<'_>, run: impl FnOnce(Bench<'_>)) {
    let (mut slots, mut readings) = ([TimedSlot::NONE; MAX], [0; MAX]);
    with_device(instrument, |device| {
        let scanner = SlotScanner::new(FakeFrontEnd::default(), &mut slots, &mut readings);
        run(Bench { device, scanner, link: FakeLink::new(), system: FakeSystem::default() });
    });
}

#[test]
fn requests_are_answered_in_their_order() {
    bench(INSTRUMENT, |mut bench| {
        assert_eq!(kinds(&bench.run(1000)), ["hello 6 120000"], "it greets its host");
        let table = [Slot { source: 3, sink: 4, measure: Some([5, 6]) }];
        let part = ScanPart { first: 0, total: 1, slots: Slots::Given(&table) };
        let said = bench.ask(&[
            ToDevice::Rate(0),
            ToDevice::Rate(60_000),
            ToDevice::Identify,
            ToDevice::Scan(part),
            ToDevice::SelfTest,
            ToDevice::Identify,
            ToDevice::Scan(ScanPart { first: 0, total: 0, slots: Slots::Given(&[]) }),
        ]);
        assert_eq!(kinds(&said), ["fault 3", "hello 6 60000", "test", "status", "hello 1 60000", "fault 2"]);
        let ToHost::Frame(test) = ToHost::parse(&said[2]).unwrap() else { panic!("a test frame") };
        assert_eq!(test.readings.get(0), Some(i32::from(test_reading(0))));
        assert!(bench.system.fed > 0);
    });
}

#[test]
fn frames_have_the_readings_of_their_slots_at_their_times() {
    bench(INSTRUMENT, |mut bench| {
        bench.run(1000);
        let said = bench.ask(&[ToDevice::Start]);
        let said: Vec<_> = said.into_iter().chain(bench.run(1_000_000)).collect();
        let frames = frames(&said);
        assert_eq!(frames.len(), 121);
        let began_us = frames[0].1;
        for (index, frame) in frames.iter().enumerate() {
            let time_us = began_us + (index as f64 * 1e6 / 120.0) as u64;
            assert!(frame.0 == index as u32 && frame.1.abs_diff(time_us) <= 1 && frame.2 == 0, "{frame:?}");
        }
        let ToHost::Frame(frame) = ToHost::parse(&said[0]).unwrap() else { panic!("a frame") };
        assert_eq!(frame.readings.iter().collect::<Vec<_>>(), SLOTS.map(|timed| i32::from(counts(timed.slot))));
        assert_eq!(kinds(&said).iter().filter(|kind| *kind == "status").count(), 1);
        // A self-test between two frames, and a stop.
        let said = bench.ask(&[ToDevice::SelfTest, ToDevice::Start, ToDevice::Stop, ToDevice::Identify]);
        assert_eq!(kinds(&said).iter().filter(|kind| *kind != "frame").count(), 3);
        assert!(bench.run(100_000).is_empty());
    });
}

/// The settling of a frame whose slots share its time: those that need less wait as long as the others, except the slow
/// one; gains as the wire protocol defines them.
#[test]
fn slots_settle_at_least_as_long_as_they_need() {
    bench(INSTRUMENT, |mut bench| {
        bench.run(1000);
        // The shortest frame: 23 us of settling, 6 of overhead, 10 between frames.
        let said = bench.ask(&[ToDevice::Rate(25_641_025), ToDevice::Rate(25_641_026), ToDevice::Start]);
        assert_eq!(kinds(&said)[0], "fault 3");
        let needed: Vec<u32> = SLOTS.iter().map(|timed| timed.wait_ns).collect();
        let waited = |bench: &mut Bench<'_>| -> Vec<u32> {
            let converted = std::mem::take(&mut bench.scanner.front_end().converted);
            converted.iter().rev().take(SLOTS.len()).rev().map(|slot| slot.2).collect()
        };
        assert_eq!(waited(&mut bench), needed);
        bench.ask(&[ToDevice::Stop, ToDevice::Rate(10_000_000), ToDevice::Start]);
        let gains: Vec<_> = bench.scanner.front_end().converted.iter().take(3).map(|slot| slot.1).collect();
        use dermis_firmware::Gain::{Driven, Free, Reference};
        assert_eq!(gains, [Reference, Driven, Free]);
        // 100 us, less 10 between frames: 15 us for each slot, 14 of them to settle.
        assert_eq!(waited(&mut bench), [14_000; 6]);
    });
}

/// A table whose slots settle too slowly lowers the rate, and a higher one is refused with the highest in the text.
#[test]
fn a_slow_table_lowers_the_rate() {
    bench(INSTRUMENT, |mut bench| {
        bench.run(1000);
        // Unknown slots take 20 us and 1 us of overhead; with 40 of them and 10 us a frame lasts 850 us.
        let table: Vec<Slot> = (0..MAX).map(|k| Slot { source: 7, sink: (k % 3) as u16, measure: None }).collect();
        let part = ScanPart { first: 0, total: MAX as u16, slots: Slots::Given(&table) };
        let said = bench.ask(&[
            ToDevice::Rate(2_000_000),
            ToDevice::Scan(part),
            ToDevice::Rate(1_200_000),
            ToDevice::Identify,
        ]);
        assert_eq!(kinds(&said), ["fault 3", "hello 40 1176470"]);
        let ToHost::Fault(fault) = ToHost::parse(&said[0]).unwrap() else { panic!("a fault") };
        assert_eq!(fault.text, "at most 1176.470 frames a second: 40 slots settle in up to 20.000 us");
    });
    // A serial line that is too slow: another kind of fault.
    bench(dermis_firmware::Instrument { baud: 9600, ..INSTRUMENT }, |mut bench| {
        assert_eq!(kinds(&bench.run(1000)), ["hello 6 26628"]);
        let said = bench.ask(&[ToDevice::Rate(30_000)]);
        let ToHost::Fault(fault) = ToHost::parse(&said[0]).unwrap() else { panic!("a fault") };
        assert_eq!(fault.code, FaultCode::Line);
        assert_eq!(fault.text, "at most 26.628 frames a second: the line carries 9600 bits a second");
    });
}

/// A line that carries a byte in 100 us: a third of the frames. Frames that are dropped use their numbers; the next one
/// says so; answers come all the same, in their order.
#[test]
fn a_slow_line_loses_frames_and_no_answers() {
    bench(INSTRUMENT, |mut bench| {
        bench.run(1000);
        bench.link.bytes_per_poll = 1;
        bench.link.ask(&ToDevice::Rate(1_000_000));
        bench.link.ask(&ToDevice::Start);
        bench.poll(1_000_000);
        for message in [ToDevice::SelfTest, ToDevice::Stop, ToDevice::Identify] {
            bench.link.ask(&message);
        }
        bench.poll(200_000);
        bench.link.bytes_per_poll = 100_000;
        let said = bench.run(10_000);
        let kinds = kinds(&said);
        assert!(kinds.ends_with(&["test".into(), "status".into(), "hello 6 1000000".into()]), "{kinds:?}");
        let frames = frames(&said);
        let gaps: u32 = frames.windows(2).map(|pair| pair[1].0 - pair[0].0 - 1).sum();
        assert!(gaps > 500, "{gaps} frames were dropped");
        for pair in frames.windows(2) {
            let is_test = pair[1].2 & FrameFlags::TEST.bits() != 0;
            let overrun = pair[1].2 & FrameFlags::OVERRUN.bits() != 0;
            assert!(is_test || overrun == (pair[1].0 != pair[0].0 + 1), "{pair:?}");
        }
        let dropped = said.iter().filter_map(|message| match ToHost::parse(message).unwrap() {
            ToHost::Status(status) => Some(status.dropped),
            _ => None,
        });
        assert_eq!(dropped.max(), Some(gaps), "the last status counts them");
    });
}

#[test]
fn unplugging_stops_it_and_keeps_table_and_rate() {
    bench(INSTRUMENT, |mut bench| {
        bench.run(1000);
        bench.ask(&[ToDevice::Rate(60_000), ToDevice::Start]);
        bench.link.to_device.extend([5, 1, 2]);
        bench.run(1000);
        bench.link.plugged = false;
        bench.run(10_000);
        assert!(!bench.device.is_running());
        bench.link.plugged = true;
        bench.link.heard();
        assert_eq!(kinds(&bench.run(50_000)), ["hello 6 60000"]);
    });
}

/// A scanner that fails at its start, or delivers no frames.
struct Broken(Option<HardwareFault>);

impl Scanner for Broken {
    fn limits(&self) -> Limits {
        Limits { overhead_ns: 0, frame_ns: 0, longest_wait_ns: u32::MAX }
    }

    fn start(&mut self, _: &Plan<'_>, _: u64) -> Result<(), HardwareFault> {
        self.0.map_or(Ok(()), Err)
    }

    fn poll(&mut self, _: u64) -> Result<Option<Scanned<'_>>, HardwareFault> {
        Ok(None)
    }

    fn stop(&mut self) {}
}

#[test]
fn a_scanner_that_fails_is_a_fault_of_the_hardware() {
    for (broken, text) in [(Some(HardwareFault("no converter")), "no converter"), (None, "the scanner has stopped")] {
        with_device(INSTRUMENT, |mut device| {
            let (mut link, mut system) = (FakeLink::new(), FakeSystem::default());
            link.ask(&ToDevice::Start);
            for _ in 0..20_000 {
                device.poll(&mut Broken(broken), &mut link, &mut system);
                system.now_us += 100;
            }
            let said = link.heard();
            let ToHost::Fault(fault) = ToHost::parse(said.last().unwrap()).unwrap() else { panic!("a fault") };
            assert_eq!((fault.code, fault.text), (FaultCode::Hardware, text));
            assert!(!device.is_running());
        });
    }
}

/// A random message, sound or not.
fn random_bytes(rng: &mut rand_chacha::ChaCha8Rng) -> Vec<u8> {
    let mut packet = vec![0; ToDevice::PACKET_BYTES];
    let slots: Vec<Slot> = (0..rng.random_range(0..20))
        .map(|_| Slot {
            source: rng.random_range(0..9),
            sink: rng.random_range(0..9),
            measure: rng.random_bool(0.7).then(|| [rng.random_range(0..9), rng.random_range(0..9)]),
        })
        .collect();
    let total = rng.random_range(slots.len() as u16..60);
    let first = rng.random_range(0..=total - slots.len() as u16);
    let message = match rng.random_range(0..9) {
        0 => ToDevice::Identify,
        1 | 2 => ToDevice::Start,
        3 => ToDevice::Stop,
        4 => ToDevice::SelfTest,
        5 => ToDevice::Rate(10u32.saturating_pow(rng.random_range(0..10)) + rng.random_range(0..3)),
        _ if rng.random_bool(0.5) => {
            ToDevice::Scan(ScanPart { first: 0, total: slots.len() as u16, slots: Slots::Given(&slots) })
        }
        _ => ToDevice::Scan(ScanPart { first, total, slots: Slots::Given(&slots) }),
    };
    let length = message.encode(&mut packet).unwrap();
    packet.truncate(length);
    match rng.random_range(0..6) {
        0 => {
            let at = rng.random_range(0..length);
            packet[at] = rng.random();
        }
        1 => packet.truncate(rng.random_range(0..length)),
        2 => {
            packet = vec![0; rng.random_range(0..700)];
            rng.fill_bytes(&mut packet);
        }
        _ => {}
    }
    packet
}

/// Random requests, damage, speeds of the line, times, and unplugging at any moment: no panic, only sound packets, and
/// afterwards the device answers.
#[test]
fn random_conversations_never_stop_the_device() {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(17);
    bench(INSTRUMENT, |mut bench| {
        for round in 0..20_000 {
            if rng.random_bool(0.02) {
                bench.link.plugged = false;
            }
            let bytes = random_bytes(&mut rng);
            bench.link.to_device.extend(bytes);
            bench.link.bytes_per_poll = [0, 1, 7, 64, 100_000][rng.random_range(0..5)];
            for _ in 0..rng.random_range(1..30) {
                bench.device.poll(&mut bench.scanner, &mut bench.link, &mut bench.system);
                bench.system.now_us += 10u64.pow(rng.random_range(0..6));
            }
            if !bench.link.plugged {
                bench.device.poll(&mut bench.scanner, &mut bench.link, &mut bench.system);
                // What was on the line is lost, and its last packet may be cut.
                bench.link.to_host.clear();
                bench.link.to_device.clear();
                bench.link.plugged = true;
            }
            if round % 100 == 99 {
                bench.link.bytes_per_poll = 100_000;
                bench.link.to_device.push_back(0);
                bench.link.ask(&ToDevice::Stop);
                bench.link.ask(&ToDevice::Identify);
                let said = bench.run(300_000);
                assert!(kinds(&said).last().is_some_and(|kind| kind.starts_with("hello")), "round {round}: {said:?}");
            }
        }
    });
}
