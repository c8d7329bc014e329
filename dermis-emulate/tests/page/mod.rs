//! A live skin with an emulated device, for the tests of page requests.

use dermis::method::MethodSet;
use dermis::pipeline::Settings;
use dermis::skin::Skin;
use dermis_emulate::emulator::{Emulator, EmulatorOptions, Script, TimedFault};
use dermis_live::{Control, Live, LiveOptions, RecordingOptions};
use dermis_sim::twin::TwinOptions;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// A skin being read; recordings are written to a folder.
pub fn live(folder: &Path) -> (Live, Arc<Control>) {
    let (live, control, _) = live_with(folder, Vec::new());
    (live, control)
}

/// The same with a device that has faults, and the device.
pub fn live_with(folder: &Path, faults: Vec<TimedFault>) -> (Live, Arc<Control>, Arc<Emulator>) {
    static METHODS: OnceLock<Arc<MethodSet>> = OnceLock::new();
    let prepare = || MethodSet::new(&dermis_learn::methods(), Skin::load("skin16").unwrap(), None).unwrap();
    let methods = METHODS.get_or_init(|| Arc::new(prepare()));
    let options = EmulatorOptions {
        twin: TwinOptions::shipped("lab").unwrap(),
        seed: 1,
        script: Script::default(),
        faults,
        speed: 1.0,
        prerendered: 0,
        unpaced: false,
    };
    let emulator = Emulator::new(methods.skin().design(), options).unwrap();
    let address = emulator.serve_locally().unwrap();
    let live = Live::start(Arc::clone(methods), LiveOptions::new(address, Settings::default())).unwrap();
    live.begin();
    let tapes = RecordingOptions { folder: folder.into(), ..Default::default() };
    let control = Arc::new(Control::new(Arc::clone(live.shared()), Some(emulator.clone()), "emulator".into(), tapes));
    (live, control, emulator)
}
