//! Devices with correct and incorrect answers: which ones a host accepts, and how it reports the others.

use dermis::skin::Skin;
use dermis_emulate::emulator::{Emulator, EmulatorOptions, Port, Script};
use dermis_live::device::{Address, Device, DeviceEvent, DeviceOptions, open};
use dermis_live::{LiveError, ScanTable};
use dermis_sim::twin::TwinOptions;
use dermis_wire::{
    Decoder, Fault, FaultCode, Frame, FrameFlags, Hello, Readings, Received, ToDevice, ToHost, VERSION, test_reading,
};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

const DESIGN: &str = "skin16";

fn skin() -> &'static Skin {
    static SKIN: OnceLock<Skin> = OnceLock::new();
    SKIN.get_or_init(|| Skin::load(DESIGN).unwrap())
}

/// Number of readings per frame.
fn slot_count() -> usize {
    ScanTable::new(&skin().design().protocol).unwrap().slots().len()
}

/// A device that answers correctly, except for the configured deviations.
#[derive(Clone)]
struct Fake {
    hello: Hello<'static>,
    /// The rate that it reports, whatever is requested.
    keeps_mhz: Option<u32>,
    /// Its faults in answer to a scan table, and to a rate.
    refuses: [Option<(FaultCode, &'static str)>; 2],
    knows_self_test: bool,
    /// A slot with swapped bytes.
    swaps: Option<usize>,
    /// Number of start requests that it ignores.
    ignored_starts: u32,
    /// What it says after its first frame.
    says_later: Option<ToHost<'static>>,
}

impl Fake {
    fn new() -> Self {
        let design = skin().design();
        let hello = Hello {
            version: VERSION,
            reading_bytes: 2,
            design_sha256: design.sha256(),
            electrode_count: design.electrodes.len() as u16,
            slot_count: slot_count() as u16,
            reference_ohm: 1000.0,
            source_v: 3.3,
            volts_per_count: [1e-4; 3],
            full_scale: 2047,
            rate_millihertz: 120_000,
            highest_rate_millihertz: 500_000,
            baud: 0,
            serial: 7,
            boot: 1,
            name: "fake",
        };
        Fake {
            hello,
            keeps_mhz: None,
            refuses: [None; 2],
            knows_self_test: true,
            swaps: None,
            ignored_starts: 0,
            says_later: None,
        }
    }

    /// Serves it and returns the address.
    fn plugged_in(self) -> Address {
        served(move |stream| self.clone().talk(stream))
    }

    fn talk(mut self, mut stream: impl Read + Write) {
        // As over USB: it sends its hello before a request.
        say(&mut stream, &ToHost::Hello(self.hello));
        let mut decoder = Decoder::new([0; ToDevice::PACKET_BYTES]);
        let mut buffer = [0; 4096];
        while let Ok(count @ 1..) = stream.read(&mut buffer) {
            let mut messages = Vec::new();
            decoder.feed(&buffer[..count], |received| match received {
                Received::Message(message) => messages.push(message.to_vec()),
                Received::Damaged => panic!("a host sends no damaged packets"),
            });
            messages.iter().for_each(|message| self.answer(&mut stream, &ToDevice::parse(message).unwrap()));
        }
    }

    fn answer(&mut self, stream: &mut impl Write, message: &ToDevice<'_>) {
        let mut refuse = |refusal: Option<(FaultCode, &'static str)>| {
            refusal.map(|(code, text)| say(stream, &ToHost::Fault(Fault { code, text }))).is_some()
        };
        match message {
            ToDevice::Identify => say(stream, &ToHost::Hello(self.hello)),
            ToDevice::Scan(_) => drop(refuse(self.refuses[0])),
            ToDevice::Rate(rate_millihertz) if !refuse(self.refuses[1]) => {
                self.hello.rate_millihertz = self.keeps_mhz.unwrap_or(*rate_millihertz);
            }
            ToDevice::SelfTest if self.knows_self_test => self.send_readings(stream, 0, FrameFlags::TEST),
            ToDevice::SelfTest => drop(refuse(Some((FaultCode::UnknownMessage, "what is 0x86?")))),
            ToDevice::Start if self.ignored_starts > 0 => self.ignored_starts -= 1,
            ToDevice::Start => {
                self.send_readings(stream, 1, FrameFlags::default());
                self.says_later.take().into_iter().for_each(|message| say(stream, &message));
            }
            ToDevice::Stop | ToDevice::Rate(_) => {}
        }
    }

    fn send_readings(&self, stream: &mut impl Write, sequence: u32, flags: FrameFlags) {
        let mut readings: Vec<i16> = (0..self.hello.slot_count).map(test_reading).collect();
        self.swaps.into_iter().for_each(|slot| readings[slot] = readings[slot].swap_bytes());
        let wide: Vec<i32> = readings.iter().map(|&reading| reading.into()).collect();
        let readings = if self.hello.reading_bytes == 2 { Readings::I16(&readings) } else { Readings::I32(&wide) };
        say(stream, &ToHost::Frame(Frame { sequence, time_us: 0, flags, readings }));
    }
}

fn say(stream: &mut impl Write, message: &ToHost<'_>) {
    let mut packet = vec![0; 4096];
    let length = message.encode(&mut packet).unwrap();
    // The host may have disconnected already.
    let _ = stream.write_all(&packet[..length]);
}

/// Calls `serve` for every connection to the returned address.
fn served(serve: impl Fn(TcpStream) + Send + 'static) -> Address {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = Address::Tcp(listener.local_addr().unwrap().to_string());
    std::thread::spawn(move || listener.incoming().for_each(|stream| serve(stream.unwrap())));
    address
}

fn meet_at(address: &Address, rate_hz: Option<f64>) -> Result<Device, LiveError> {
    Device::connect(address, skin(), DeviceOptions { rate_hz, ..DeviceOptions::default() }, None)
}

fn met(fake: Fake, rate_hz: Option<f64>) -> Device {
    meet_at(&fake.plugged_in(), rate_hz).unwrap_or_else(|error| panic!("{error}"))
}

/// The error message of a refused device.
fn refused(fake: Fake, rate_hz: Option<f64>) -> String {
    match meet_at(&fake.plugged_in(), rate_hz) {
        Err(error @ LiveError::Refused { .. }) => error.to_string(),
        Err(error) => panic!("lost, not refused: {error}"),
        Ok(_) => panic!("taken"),
    }
}

/// The notices of a device until the first frame.
fn told(device: &mut Device) -> Vec<String> {
    let (mut texts, mut done, begun) = (Vec::new(), false, Instant::now());
    while !done {
        assert!(begun.elapsed() < Duration::from_secs(3), "no frame");
        let tell = |heard: DeviceEvent| match heard {
            DeviceEvent::Frame(frame) => {
                assert_eq!(
                    (frame.input.sequence, frame.input.counts.frames, frame.input.counts.lost),
                    (1, 1, 0),
                    "a test is no frame"
                );
                done = true;
            }
            DeviceEvent::Notice(notice) => texts.push(notice.text),
            DeviceEvent::Status(_) => {}
        };
        device.listen(tell).unwrap();
    }
    texts
}

#[test]
fn a_device_is_configured_tested_and_identified_again() {
    skin();
    let begun = Instant::now();
    let mut device = met(Fake::new(), Some(60.0));
    let seconds = begun.elapsed().as_secs_f64();
    assert!(seconds < 0.4, "{seconds} s: answers are not waited for longer than they take");
    assert_eq!((device.facts().rate_hz, device.facts().serial), (60.0, 7));
    // Recordings store the last hello.
    let Ok(ToHost::Hello(hello)) = ToHost::parse(&device.facts().hello) else { panic!("a hello") };
    assert_eq!(hello.rate_millihertz, 60_000);
    assert!(told(&mut device).is_empty());
    let mut wide = Fake::new();
    wide.hello.reading_bytes = 4;
    assert!(told(&mut met(wide, None)).is_empty());
}

#[test]
fn an_older_device_without_a_self_test_is_read_and_that_is_said() {
    let texts = told(&mut met(Fake { knows_self_test: false, ..Fake::new() }, None));
    assert!(matches!(texts.as_slice(), [text] if text.contains("no self-test")), "{texts:?}");
}

#[test]
fn a_device_that_missed_its_start_is_started_again() {
    told(&mut met(Fake { ignored_starts: 1, ..Fake::new() }, None));
}

#[test]
fn a_device_that_was_restarted_behind_an_open_line_is_lost_and_the_same_hello_is_no_news() {
    let hello = Fake::new().hello;
    let no_table = Fault { code: FaultCode::ScanTable, text: "no table" };
    for (message, expected) in [
        (ToHost::Hello(hello), None),
        (ToHost::Hello(Hello { boot: 2, ..hello }), Some("its hello is not that of before")),
        (ToHost::Hello(Hello { serial: 8, ..hello }), Some("its hello is not that of before")),
        (ToHost::Hello(Hello { volts_per_count: [2e-4; 3], ..hello }), Some("its hello is not that of before")),
        (ToHost::Fault(no_table), Some("no table")),
    ] {
        let mut device = met(Fake { says_later: Some(message), ..Fake::new() }, None);
        let begun = Instant::now();
        let mut lost = None;
        while lost.is_none() && begun.elapsed() < Duration::from_millis(500) {
            lost = device.listen(|_| ()).err().map(|error| error.to_string());
        }
        assert_eq!(lost.is_some(), expected.is_some(), "{message:?}: {lost:?}");
        assert!(expected.is_none_or(|expected| lost.is_some_and(|lost| lost.contains(expected))));
    }
}

#[test]
fn a_device_that_cannot_is_refused_in_its_own_words() {
    let at = |place: usize, refusal| {
        let mut fake = Fake::new();
        fake.refuses[place] = Some(refusal);
        fake
    };
    let why = refused(at(0, (FaultCode::ScanTable, "I have 8 electrodes")), None);
    assert!(why.contains("I have 8 electrodes"), "{why}");
    let why = refused(at(1, (FaultCode::Rate, "at most 90 Hz")), Some(100.0));
    assert!(why.contains("at most 90 Hz"), "{why}");
    let why = refused(at(1, (FaultCode::UnknownMessage, "what is 0x85?")), None);
    assert!(why.contains("0x85") && why.contains("update"), "{why}");
    // A firmware that supports neither the scan table nor the self-test, but states the same number of readings.
    let mut fake = Fake { knows_self_test: false, ..Fake::new() };
    fake.refuses[0] = Some((FaultCode::UnknownMessage, "what is 0x84?"));
    let why = refused(fake, None);
    assert!(why.contains("0x84") && why.contains("update"), "{why}");
    let why = refused(Fake { keeps_mhz: Some(90_000), ..Fake::new() }, Some(100.0));
    assert!(why.contains("100 times a second") && why.contains("90 times a second"), "{why}");
}

#[test]
fn a_self_test_that_is_wrong_names_the_slot() {
    let why = refused(Fake { swaps: Some(5), ..Fake::new() }, None);
    let (is, shall) = (test_reading(5).swap_bytes(), test_reading(5));
    assert!(why.contains(&format!("slot 5 (channel 4): {is} in place of {shall}")), "{why}");
    assert!(why.contains(&format!("1 of {} readings", slot_count())), "{why}");
}

#[test]
fn what_a_host_must_refuse_it_refuses_with_the_reason() {
    type Change = fn(&mut Hello<'static>);
    let with = |change: Change| {
        let mut fake = Fake::new();
        change(&mut fake.hello);
        refused(fake, None)
    };
    let cases: [(Change, &[&str]); 8] = [
        (|hello| hello.version = 9, &["version 9", "version 1", "update"]),
        (|hello| hello.electrode_count = 30, &["30 electrodes", "16"]),
        (|hello| hello.design_sha256[0] ^= 1, &["another skin", "scan-table"]),
        (|hello| hello.reference_ohm = f32::NAN, &["NaN", "positive"]),
        (|hello| hello.volts_per_count[2] = 0.0, &["scale of 0", "positive"]),
        (|hello| hello.full_scale = 0, &["full scale of 0"]),
        (|hello| hello.highest_rate_millihertz = 100_000, &["120 frames", "at most 100"]),
        (|hello| hello.rate_millihertz = 0, &["rate of 0", "--rate"]),
    ];
    for (change, words) in cases {
        let why = with(change);
        assert!(words.iter().all(|word| why.contains(word)), "{why}");
    }
}

#[test]
fn peers_that_are_not_devices_are_distinguished() {
    let unreachable = |serve: fn(TcpStream)| {
        let begun = Instant::now();
        let error = meet_at(&served(serve), None).err().expect("no device").to_string();
        assert!(begun.elapsed() < Duration::from_millis(2500), "{error}");
        error
    };
    let silent = unreachable(|stream| {
        std::thread::sleep(Duration::from_secs(3));
        drop(stream);
    });
    assert!(silent.contains("nothing came in 2 s") && silent.contains("is it on"), "{silent}");
    let web = unreachable(|mut stream| {
        let _ = stream.write_all(b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n");
    });
    assert!(web.contains("47 bytes came and no hello") && web.contains("is the port right"), "{web}");
    let noise = unreachable(|mut stream| {
        let bytes: Vec<u8> = (0..5000u32).map(|k| (k.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
        while stream.write_all(&bytes).is_ok() {
            std::thread::sleep(Duration::from_millis(50));
        }
    });
    assert!(noise.contains("no hello"), "{noise}");
    let gone = unreachable(drop);
    assert!(gone.contains("was lost"), "{gone}");
}

/// Bytes at a wrong baud rate: a pseudo terminal has none, so its other end sends what a UART would read.
#[cfg(unix)]
#[test]
fn a_wrong_baud_rate_is_reported() {
    let (port, path) = dermis_emulate::emulator::pseudo_terminal().unwrap();
    let Port::Terminal { mut device, _host } = port else { panic!("a terminal") };
    std::thread::spawn(move || {
        while device.write_all(&[0xF8, 0x00, 0xFE, 0xE0, 0x80]).is_ok() {
            std::thread::sleep(Duration::from_millis(20));
        }
    });
    let address = Address::Serial { port: path.display().to_string(), baud: 115_200 };
    let error = meet_at(&address, None).err().expect("no device").to_string();
    assert!(error.contains("115200 bits a second") && error.contains("@BAUD"), "{error}");
}

#[cfg(unix)]
#[test]
fn a_port_has_one_program_at_a_time() {
    let (_device, path) = dermis_emulate::emulator::pseudo_terminal().unwrap();
    let address = Address::Serial { port: path.display().to_string(), baud: 115_200 };
    let first = open(&address).unwrap();
    let error = open(&address).err().expect("taken").to_string();
    assert!(error.contains("in use by another program"), "{error}");
    drop(first);
    open(&address).unwrap();
}

#[cfg(unix)]
#[test]
fn a_serial_line_that_is_too_slow_is_refused_with_the_smallest_speed_that_does() {
    let mut fake = Fake::new();
    fake.hello.baud = 115_200;
    let (port, path) = dermis_emulate::emulator::pseudo_terminal().unwrap();
    let Port::Terminal { device, _host } = port else { panic!("a terminal") };
    let on_wire = fake.clone();
    std::thread::spawn(move || on_wire.talk(device));
    let address = Address::Serial { port: path.display().to_string(), baud: 115_200 };
    let why = meet_at(&address, None).err().expect("too slow").to_string();
    assert!(why.contains("115200 bits a second is too slow") && why.contains("576000"), "{why}");
    // Over TCP the baud rate does not matter.
    told(&mut met(fake, None));
}

fn emulated(twin: &str) -> Arc<Emulator> {
    let design = skin().design();
    let options = EmulatorOptions {
        twin: TwinOptions::shipped(twin).unwrap(),
        seed: 3,
        script: Script::default(),
        faults: Vec::new(),
        speed: 1.0,
        prerendered: 0,
        unpaced: false,
    };
    Emulator::new(design, options).unwrap()
}

#[test]
fn emulated_devices_pass_their_self_test_whatever_the_width_of_their_readings() {
    for twin in ["lab", "ideal"] {
        let emulator = emulated(twin);
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = Address::Tcp(listener.local_addr().unwrap().to_string());
        let served = Arc::clone(&emulator);
        std::thread::spawn(move || served.serve(Port::Tcp(listener)).unwrap());
        let begun = Instant::now();
        let mut device = meet_at(&address, Some(60.0)).unwrap();
        println!("{twin}: met in {:.1} ms", 1e3 * begun.elapsed().as_secs_f64());
        assert_eq!(device.facts().rate_hz, 60.0);
        assert!(told(&mut device).is_empty());
        emulator.stop();
    }
}
