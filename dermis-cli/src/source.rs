//! The source of live frames, and the page that shows them.

use crate::console::note;
use crate::emulated::EmulatorArguments;
use crate::failure::{Failure, Outcome};
use crate::range::number;
use clap::Args;
use dermis::design::SkinDesign;
use dermis::method::MethodSet;
use dermis::pipeline::Settings;
use dermis::skin::Skin;
use dermis_emulate::emulator::Emulator;
use dermis_live::device::{Address, DeviceOptions};
use dermis_live::recording::RecordingLimits;
use dermis_live::sinks::viewer::{RobotServer, Server, ServerOptions};
use dermis_live::{Control, Live, LiveOptions, Pressable, RecordingOptions};
use dermis_robot::Robot;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Longest file of a token, bytes.
const LONGEST_TOKEN: u64 = 4096;

/// Folder of the recordings that a page begins.
const RECORDINGS: &str = "recordings";

/// Where live frames come from.
#[derive(Debug, Args)]
pub struct SourceArguments {
    /// Source of frames: `emulate` (a simulated device inside this program), tcp:HOST:PORT, serial:PATH[@BAUD],
    /// replay:FILE (a recording, at its own rate or --speed times as fast); or rows of values of an existing
    /// instrument, a frame (ohm) in each line: csv:- (standard input), csv:tcp:HOST:PORT, csv:serial:PATH[@BAUD].
    #[arg(long, value_name = "SOURCE", default_value = "emulate")]
    source: String,
    /// Frame rate [default: the device's own; rows of values without times: measured from their arrival]
    #[arg(long, value_name = "HZ", value_parser = number(0.001..=1e6))]
    pub rate: Option<f64>,
    #[command(flatten)]
    pub emulator: EmulatorArguments,
}

impl SourceArguments {
    /// The recording to replay, if that is the source.
    pub fn recording(&self) -> Option<&Path> {
        self.source.strip_prefix("replay:").map(Path::new)
    }

    /// Whether the rows of standard input are the source.
    pub fn is_stdin(&self) -> bool {
        self.source == "csv:-"
    }

    /// Whether the source is a simulation whose frames may be all the same.
    pub fn is_noise_free(&self) -> bool {
        self.source == "emulate" && self.emulator.is_noise_free()
    }

    /// Starts to read a skin that may be unlike its model: what it is like is to be found out.
    pub fn start(&self, skin: &Skin, difference: bool) -> Outcome<(Live, Option<Arc<Emulator>>)> {
        let (address, emulator) = self.address(skin.design())?;
        let methods = Arc::new(MethodSet::new(&dermis_learn::methods(), skin.clone(), None)?);
        let device = DeviceOptions { rate_hz: self.rate, difference, ..DeviceOptions::default() };
        let settings = Settings { force_tare: true, ..Settings::default() };
        Ok((Live::start(methods, LiveOptions { device, ..LiveOptions::new(address, settings) })?, emulator))
    }

    /// The address of the device; starts an emulated one.
    pub fn address(&self, design: &SkinDesign) -> Outcome<(Address, Option<Arc<Emulator>>)> {
        if self.source != "emulate" {
            return Ok((Address::parse(&self.source)?, None));
        }
        let emulator = self.emulator.emulator(design)?;
        let address = emulator.serve_locally()?;
        Ok((address, Some(emulator)))
    }

    /// The controls of a live skin with this source.
    pub fn control(&self, live: &Live, emulator: Option<Arc<Emulator>>, limits: RecordingLimits) -> Outcome<Control> {
        let recordings = RecordingOptions {
            folder: PathBuf::from(RECORDINGS),
            twin_toml: emulator.as_ref().map(|_| self.emulator.twin_text()).transpose()?,
            limits,
        };
        let source = if emulator.is_some() { self.emulator.summary() } else { self.source.clone() };
        let pressed = emulator.map(|emulator| emulator as Arc<dyn Pressable>);
        Ok(Control::new(Arc::clone(live.shared()), pressed, source, recordings))
    }
}

/// The page of a live skin.
#[derive(Debug, Args)]
pub struct PageArguments {
    /// Address of the viewer, or `off`. Any address beyond this machine needs --token.
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:8420")]
    serve: String,
    /// Access token of the viewer, at least eight characters. Other users of this machine can see it in the list of
    /// processes: --token-file and the variable DERMIS_TOKEN do not show it.
    #[arg(long, value_name = "SECRET", conflicts_with = "token_file")]
    token: Option<String>,
    /// File with the access token on its only line.
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
}

impl PageArguments {
    /// Serves the page and prints its address.
    pub fn serve(&self, control: &Arc<Control>) -> Outcome<Option<Server>> {
        let Some(options) = self.options()? else { return Ok(None) };
        let server = Server::start(Arc::clone(control), &options)?;
        self.announce(&server);
        Ok(Some(server))
    }

    /// Serves the page of a robot and prints its address.
    pub fn serve_robot(&self, robot: &Robot) -> Outcome<Option<RobotServer>> {
        let Some(options) = self.options()? else { return Ok(None) };
        let server = RobotServer::start(robot, &options)?;
        self.announce(server.server());
        Ok(Some(server))
    }

    /// None without a page.
    fn options(&self) -> Outcome<Option<ServerOptions>> {
        if self.serve == "off" {
            return Ok(None);
        }
        Ok(Some(ServerOptions { address: self.serve.clone(), token: self.secret()? }))
    }

    fn announce(&self, server: &Server) {
        // A token that is not an argument stays hidden.
        let is_hidden = server.url() != server.url_without_token() && self.token.is_none();
        match is_hidden {
            true => note(&format!("the viewer is at {}?token=TOKEN", server.url_without_token())),
            false => note(&format!("the viewer is at {}", server.url())),
        }
    }

    /// The access token: as an argument, in a file or in the environment.
    fn secret(&self) -> Outcome<Option<String>> {
        let Some(path) = &self.token_file else {
            let of_environment = || std::env::var("DERMIS_TOKEN").ok().filter(|token| !token.is_empty());
            return Ok(self.token.clone().or_else(of_environment));
        };
        let mut text = String::new();
        let read = File::open(path).and_then(|file| file.take(LONGEST_TOKEN).read_to_string(&mut text));
        read.map_err(|error| {
            let message = format!("cannot read the token in {}: {error}", path.display());
            Failure::given(message, Some("write one there: openssl rand -hex 16 > FILE; chmod 600 FILE"))
        })?;
        Ok(Some(text.trim_end_matches(['\r', '\n']).to_string()))
    }
}
