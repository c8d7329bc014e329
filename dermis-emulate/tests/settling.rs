//! Settling of a reader's lines by another program: ngspice solves the transients of slots of a skin of 20 kohm per square,
//! as a network of resistors with switches and the capacitances of the lines. At the firmware's settling times readings are
//! within half a step of the converter, at those that 120 Hz leaves they are not, and the firmware refuses that rate.
//!
//! Without ngspice the transients are skipped, with a message.

use dermis::design::SkinDesign;
use dermis::forward::{ElectrodeNetwork, ForwardModel};
use dermis::mesh::Mesh;
use dermis_emulate::firmware::ReaderPlan;
use dermis_firmware::{Device, Gone, HardwareFault, Limits, Link, Memory, Plan, Scanned, Scanner, System, TimedSlot};
use dermis_sim::twin::TwinOptions;
use dermis_sim::twin::electronics::{ElectronicsOptions, Switching};
use dermis_wire::{Decoder, FaultCode, Received, Slot, ToDevice, ToHost};
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

/// Sheet resistance of the coat, ohm per square.
const SHEET_OHM: f64 = 20e3;
/// Charge of a switch, C (docs/firmware.md).
const CHARGE_C: f64 = 1e-12;
/// Steps of a transient: the error of the trapezoidal rule is far below half a step of the converter.
const STEPS: f64 = 4000.0;
/// A slot beside its settling on the Pico, and a slot of 900 at 120 Hz, ns.
const OVERHEAD_NS: u32 = 1504;
const SLOT_120_HZ_NS: u32 = 9259;

/// The skin, its network, the electronics, and the firmware's plan for them.
struct Reader {
    network: ElectrodeNetwork,
    electronics: ElectronicsOptions,
    plan: ReaderPlan,
}

fn reader() -> Reader {
    let mut design = SkinDesign::shipped("cylinder30").unwrap();
    design.sheet.conductance = 1.0 / SHEET_OHM;
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../dermis-firmware/boards/reader.toml");
    let twin = TwinOptions::load(&path.to_string_lossy()).unwrap();
    let model = ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap();
    let network = model.network(model.rest_conductivity()).unwrap();
    let switching = Switching { charge_c: CHARGE_C, aperture_s: 0.0 };
    let plan = ReaderPlan::new(&design, &twin, switching).unwrap();
    Reader { network, electronics: twin.electronics, plan }
}

impl Reader {
    /// Half a step of the converter at the gain of a slot, V.
    fn half_step_v(&self, slot: Slot) -> f64 {
        let adc = self.electronics.adc.unwrap();
        let gain = match slot.measure {
            None => adc.gain_reference,
            Some(inputs) if inputs.contains(&slot.source) || inputs.contains(&slot.sink) => adc.gain_driven,
            Some(_) => adc.gain,
        };
        0.5 * adc.range_v / gain / 2f64.powi(adc.bits as i32 - 1)
    }

    /// The circuit of a slot, with the voltages of the lines (source, plus, minus) when its switches close.
    fn netlist(&self, slot: Slot, lines_v: [f64; 3], times_ns: &[u32]) -> String {
        let ElectronicsOptions { source_v, reference_ohm, on_resistance_ohm, line_capacitance_f, .. } =
            self.electronics;
        let mut text =
            format!("* slot of a reader\nV1 supply 0 {source_v}\nRreference supply source {reference_ohm}\n");
        for (line, volts) in ["source", "plus", "minus"].iter().zip(lines_v) {
            let _ = writeln!(text, "C{line} {line} 0 {line_capacitance_f:e} ic={volts}");
        }
        let [plus, minus] = match slot.measure {
            None => ["supply".into(), "source".into()],
            Some(inputs) => inputs.map(|electrode| format!("e{electrode}")),
        };
        let (source, sink) = (format!("e{}", slot.source), format!("e{}", slot.sink));
        let switches = [("source", source.as_str()), ("plus", &plus), ("minus", &minus), ("0", &sink)];
        for (number, (line, end)) in switches.into_iter().enumerate() {
            let _ = writeln!(text, "Rswitch{number} {line} {end} {on_resistance_ohm}");
        }
        let count = self.network.admittance.row(0).len();
        for (a, b) in (0..count).flat_map(|b| (0..b).map(move |a| (a, b))) {
            let _ = writeln!(text, "Rskin{a}_{b} e{a} e{b} {:.12e}", -1.0 / self.network.admittance.at(a, b));
        }
        text.push_str(".options reltol=1e-9 abstol=1e-16 vntol=1e-12 chgtol=1e-24\n.control\nset numdgt=14\nop\n");
        text.push_str("print v(plus)-v(minus)\n");
        for &time_ns in times_ns {
            let (end_s, step_s) = (f64::from(time_ns) * 1e-9, f64::from(time_ns) * 1e-9 / STEPS);
            let _ = writeln!(text, "tran {step_s:e} {end_s:e} 0 {step_s:e} uic");
            text.push_str("let off = v(plus)-v(minus)\nprint off[length(off)-1]\n");
        }
        text + "quit\n.endc\n.end\n"
    }

    /// The largest errors of a slot's reading at some times over half a step of the converter, for lines that start at
    /// either end of the supply, moved by the charge of a switch.
    fn worst(&self, slot: Slot, times_ns: &[u32]) -> Vec<f64> {
        let injected_v = CHARGE_C / self.electronics.line_capacitance_f;
        let ends_v = [-injected_v, self.electronics.source_v + injected_v];
        let mut worst = vec![0.0f64; times_ns.len()];
        for corner in 0..8 {
            let lines_v = [0, 1, 2].map(|line| ends_v[(corner >> line) & 1]);
            let values_v = ngspice(&self.netlist(slot, lines_v, times_ns));
            assert_eq!(values_v.len(), 1 + times_ns.len(), "one value of each run");
            for (worst, value_v) in worst.iter_mut().zip(&values_v[1..]) {
                *worst = worst.max((value_v - values_v[0]).abs() / self.half_step_v(slot));
            }
        }
        worst
    }
}

/// The values that a netlist prints.
fn ngspice(netlist: &str) -> Vec<f64> {
    let file = tempfile::Builder::new().suffix(".cir").tempfile().unwrap();
    std::fs::write(file.path(), netlist).unwrap();
    let said = Command::new("ngspice").arg("-b").arg(file.path()).output().unwrap();
    let text = String::from_utf8_lossy(&said.stdout);
    let value = |line: &str| line.split_once(" = ").and_then(|(_, value)| value.trim().parse().ok());
    text.lines().filter(|line| line.starts_with("v(plus)") || line.starts_with("off[")).filter_map(value).collect()
}

/// The current, a reading with a driven electrode, the slots that settle fastest and slowest, and one in between.
fn some_slots(plan: &ReaderPlan) -> Vec<TimedSlot> {
    let mut measured: Vec<TimedSlot> = plan.slots().iter().copied().filter(|one| one.slot.measure.is_some()).collect();
    let first = measured[0];
    measured.sort_by_key(|one| one.wait_ns);
    vec![plan.slots()[0], first, measured[0], measured[measured.len() / 2], measured[measured.len() - 1]]
}

#[test]
fn slots_have_settled_when_they_are_read() {
    if Command::new("ngspice").arg("--version").output().is_err() {
        println!("skipped: ngspice is not installed");
        return;
    }
    let reader = reader();
    let at_120_hz_ns = SLOT_120_HZ_NS - OVERHEAD_NS;
    let mut worst_at_120_hz = 0.0f64;
    for TimedSlot { slot, wait_ns } in some_slots(&reader.plan) {
        let worst = reader.worst(slot, &[wait_ns, wait_ns / 2, at_120_hz_ns]);
        println!(
            "{slot:?}: {:.3} us, off by {:.2e} half steps; {:.2e} in half of the time, {:.2e} at 120 Hz",
            f64::from(wait_ns) * 1e-3,
            worst[0],
            worst[1],
            worst[2]
        );
        assert!(worst[0] <= 1.0, "{slot:?} has not settled in {wait_ns} ns: {} half steps", worst[0]);
        assert!(worst[1] > 1.0, "{slot:?} settles in half of its time: the table wastes time");
        worst_at_120_hz = worst_at_120_hz.max(worst[2]);
    }
    assert!(worst_at_120_hz > 10.0, "120 Hz would do: {worst_at_120_hz} half steps");
}

/// A host that sends requests and keeps the answers.
struct Host {
    requests: Vec<u8>,
    answers: Vec<u8>,
}

impl Link for Host {
    fn connected(&mut self) -> bool {
        true
    }

    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, Gone> {
        let count = buffer.len().min(self.requests.len());
        buffer.iter_mut().zip(self.requests.drain(..count)).for_each(|(place, byte)| *place = byte);
        Ok(count)
    }

    fn send(&mut self, bytes: &[u8]) -> Result<usize, Gone> {
        self.answers.extend(bytes);
        Ok(bytes.len())
    }
}

/// A board with the timing of the Pico and no front end.
struct Board;

impl Scanner for Board {
    fn limits(&self) -> Limits {
        Limits { overhead_ns: OVERHEAD_NS, frame_ns: 0, longest_wait_ns: 10_000_000 }
    }

    fn start(&mut self, _: &Plan<'_>, _: u64) -> Result<(), HardwareFault> {
        Ok(())
    }

    fn poll(&mut self, _: u64) -> Result<Option<Scanned<'_>>, HardwareFault> {
        Ok(None)
    }

    fn stop(&mut self) {}
}

impl System for Board {
    fn now_us(&mut self) -> u64 {
        0
    }
}

/// The device of 20 kohm per square starts with a lower rate than 120 Hz and refuses 120 Hz with fault 3, in words.
#[test]
fn a_rate_at_which_lines_do_not_settle_is_refused() {
    let plan = reader().plan;
    let most = plan.slots().len();
    let mut tables = [vec![TimedSlot::NONE; most], vec![TimedSlot::NONE; most]];
    let (mut tested, mut outbox) = (vec![0; most], vec![0; Memory::outbox_bytes(most)]);
    let [complete, arriving] = &mut tables;
    let memory = Memory { tables: [complete, arriving], readings: &mut tested, outbox: &mut outbox };
    let mut device = Device::new(plan.instrument("20 kohm", 0, 0), memory);
    let mut packet = [0; ToDevice::PACKET_BYTES];
    let length = ToDevice::Rate(120_000).encode(&mut packet).unwrap();
    let mut host = Host { requests: packet[..length].to_vec(), answers: Vec::new() };
    (0..10).for_each(|_| device.poll(&mut Board, &mut host, &mut Board));
    let mut answers = Vec::new();
    Decoder::new(vec![0; 1024]).feed(&host.answers, |received| match received {
        Received::Message(message) => answers.push(message.to_vec()),
        Received::Damaged => panic!("a damaged packet"),
    });
    let Ok(ToHost::Hello(hello)) = ToHost::parse(&answers[0]) else { panic!("a hello") };
    assert!(hello.rate_millihertz < 120_000 && hello.rate_millihertz == hello.highest_rate_millihertz, "{hello:?}");
    let Ok(ToHost::Fault(fault)) = ToHost::parse(&answers[1]) else { panic!("a fault") };
    println!("{}", fault.text);
    assert_eq!(fault.code, FaultCode::Rate);
    assert!(fault.text.contains("slots settle in up to"), "{}", fault.text);
}
