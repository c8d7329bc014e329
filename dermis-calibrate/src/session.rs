//! A calibration session: places to press, the presses taken, and their files.

use crate::calibration::{Calibration, Label, LabelFrame, MIN_LABELS, Quality};
use crate::error::CalibrateError;
use crate::places::Places;
use dermis::contact::Contact;
use dermis::frame::{Frame, Truth, read_frames, read_truth, write_frames, write_truth};
use dermis::geom::vector::distance;
use dermis::geom::{PlaceLimits, Point3};
use dermis::plausibility::Plausibility;
use dermis::skin::Skin;
use std::path::{Path, PathBuf};

/// The files of a session: differences from the untouched skin, and their presses.
const FRAMES: &str = "frames.csv";
const PRESSES: &str = "presses.csv";
/// A press belongs to a place within this distance, m: files round.
const SAME_M: f64 = 1e-6;

/// Presses of one skin, taken place by place and stored in a folder.
///
/// The folder holds `frames.csv` and `presses.csv`, as `dermis calibrate --frames FILE --difference --truth FILE` reads
/// them. A session in a folder that has them goes on.
///
/// ```
/// use dermis::frame::Frame;
/// use dermis::skin::Skin;
/// use dermis_calibrate::{Places, Session};
///
/// let skin = Skin::load("skin16")?;
/// let folder = std::env::temp_dir().join(format!("dermis-session-{}", std::process::id()));
/// let mut session = Session::open(&skin, &folder, Places::spread(&skin, 3))?;
/// let first = session.place();
/// session.take(Frame(vec![0.5; skin.design().protocol.channel_count()]))?;
/// session.skip();
///
/// let again = Session::open(&skin, &folder, Places::spread(&skin, 3))?;
/// assert_eq!((again.taken(), again.left()), (1, 2)); // what was skipped is asked for again
/// assert!(again.place() != first);
/// # std::fs::remove_dir_all(&folder)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Session {
    skin: Skin,
    limits: PlaceLimits,
    folder: PathBuf,
    places: Places,
    state: Vec<PlaceState>,
    frames: Vec<Frame>,
    presses_m: Vec<Point3>,
}

/// What became of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PlaceState {
    Open,
    Taken,
    Skipped,
}

/// A calibration to be computed from the presses so far, outside the session.
#[derive(Debug)]
pub struct SessionFit {
    skin: Skin,
    folder: PathBuf,
    frames: Vec<Frame>,
    labels: Vec<Label>,
}

impl SessionFit {
    /// Number of its presses.
    pub fn presses(&self) -> usize {
        self.labels.len()
    }

    /// Computes the calibration and writes it to the folder.
    ///
    /// # Errors
    /// As [`Calibration::fit`] and [`Calibration::save`].
    pub fn run(&self) -> Result<Quality, CalibrateError> {
        let calibration = Calibration::fit(&self.skin, &self.frames, &self.labels, LabelFrame::Skin)?;
        calibration.save(&self.folder, self.skin.design())?;
        Ok(*calibration.quality())
    }
}

impl Session {
    /// Begins a session in a folder, or continues the one that is there.
    ///
    /// # Errors
    /// A folder that cannot be made; files of another skin, or that do not belong together.
    pub fn open(skin: &Skin, folder: &Path, places: Places) -> Result<Self, CalibrateError> {
        std::fs::create_dir_all(folder).map_err(|source| CalibrateError::Io { path: folder.to_path_buf(), source })?;
        let limits = skin.place_limits();
        let state = vec![PlaceState::Open; places.positions_m.len()];
        let (skin, folder) = (skin.clone(), folder.to_path_buf());
        let mut session = Session { skin, limits, folder, places, state, frames: Vec::new(), presses_m: Vec::new() };
        if session.folder.join(FRAMES).exists() && session.folder.join(PRESSES).exists() {
            let (path, protocol) = (session.folder.join(FRAMES), &session.skin.design().protocol);
            session.frames = read_frames(&path, protocol)?;
            let check = Plausibility::new(protocol, session.skin.untouched()?, &[]);
            if let Some(found) = check.of_differences(&session.frames) {
                let message = format!("it is no file of a session, give another folder: {}", found.evidence);
                return Err(CalibrateError::File { path, message });
            }
            session.presses_m = session.read_presses()?;
            // A run that was killed between the two files has a frame more.
            session.frames.truncate(session.presses_m.len());
        }
        for press_m in session.presses_m.clone() {
            if let Some(index) = session.index_of(press_m, PlaceState::Open) {
                session.state[index] = PlaceState::Taken;
            }
        }
        Ok(session)
    }

    /// The presses of the file, one for each frame up to the last one.
    fn read_presses(&self) -> Result<Vec<Point3>, CalibrateError> {
        let path = self.folder.join(PRESSES);
        let Truth::OnSkin(touches) = read_truth(&path, &self.limits, self.frames.len())? else {
            return Err(CalibrateError::File { path, message: "it has no header: it is not of a session".into() });
        };
        let count = touches.iter().rposition(|touches| !touches.is_empty()).map_or(0, |last| last + 1);
        let one = |(frame, touches): (usize, &Vec<Contact>)| match touches[..] {
            [touch] => Ok(touch.position_m),
            _ => {
                let message = format!("frame {frame} has {} presses: one is needed", touches.len());
                Err(CalibrateError::File { path: path.clone(), message })
            }
        };
        touches[..count].iter().enumerate().map(one).collect()
    }

    /// The first place with a state at a position.
    fn index_of(&self, position_m: Point3, state: PlaceState) -> Option<usize> {
        let is_it = |index: &usize| {
            self.state[*index] == state && distance(self.places.positions_m[*index], position_m) < SAME_M
        };
        (0..self.state.len()).find(is_it)
    }

    fn open_place(&self) -> Option<usize> {
        self.state.iter().position(|state| *state == PlaceState::Open)
    }

    /// The place to press next; `None` at the end.
    pub fn place(&self) -> Option<Point3> {
        self.open_place().map(|index| self.places.positions_m[index])
    }

    /// The skin.
    pub fn skin(&self) -> &Skin {
        &self.skin
    }

    /// Presses taken, those of earlier runs included.
    pub fn taken(&self) -> usize {
        self.presses_m.len()
    }

    /// Places not pressed yet, without those skipped.
    pub fn left(&self) -> usize {
        self.state.iter().filter(|state| **state == PlaceState::Open).count()
    }

    /// The part of the skin's area within [`reach_m`](Places::reach_m) of a press.
    pub fn coverage(&self) -> f64 {
        self.places.coverage(&self.skin, &self.presses_m)
    }

    /// The distance of [`coverage`](Self::coverage), m.
    pub fn reach_m(&self) -> f64 {
        self.places.reach_m
    }

    /// Stores the press of the present place: its difference from the untouched skin, ohm.
    ///
    /// # Errors
    /// Files that cannot be written: the press is not taken.
    pub fn take(&mut self, difference: Frame) -> Result<(), CalibrateError> {
        let Some(index) = self.open_place() else { return Ok(()) };
        self.frames.push(difference);
        self.presses_m.push(self.places.positions_m[index]);
        if let Err(error) = self.store() {
            self.frames.pop();
            self.presses_m.pop();
            return Err(error);
        }
        self.state[index] = PlaceState::Taken;
        Ok(())
    }

    /// Leaves the present place out.
    pub fn skip(&mut self) {
        if let Some(index) = self.open_place() {
            self.state[index] = PlaceState::Skipped;
        }
    }

    /// Discards the last press: its place is the next one again. Returns whether there was one of these places.
    ///
    /// # Errors
    /// Files that cannot be written.
    pub fn redo(&mut self) -> Result<bool, CalibrateError> {
        let Some(last_m) = self.presses_m.last() else { return Ok(false) };
        let index = (0..self.state.len()).rev().find(|&index| {
            self.state[index] == PlaceState::Taken && distance(self.places.positions_m[index], *last_m) < SAME_M
        });
        let Some(index) = index else { return Ok(false) };
        self.presses_m.pop();
        self.frames.pop();
        self.state[index] = PlaceState::Open;
        self.store()?;
        Ok(true)
    }

    /// Writes both files, and takes the presses as they are in the file: a calibration from the files is the same.
    fn store(&mut self) -> Result<(), CalibrateError> {
        let [frames, presses] = [FRAMES, PRESSES].map(|name| self.folder.join(name));
        if self.frames.is_empty() {
            for path in [frames, presses] {
                std::fs::remove_file(&path).map_err(|source| CalibrateError::Io { path, source })?;
            }
            return Ok(());
        }
        write_frames(&frames, &self.frames)?;
        let touch = |position_m: &Point3| vec![Contact::truth(*position_m, [f64::NAN; 3], f64::NAN)];
        let truth: Vec<Vec<Contact>> = self.presses_m.iter().map(touch).collect();
        write_truth(&presses, &self.limits.surface, &truth)?;
        self.presses_m = self.read_presses()?;
        Ok(())
    }

    /// The differences of the presses so far, ohm, and their labels.
    pub fn presses(&self) -> (&[Frame], Vec<Label>) {
        let label = |(row, &position_m): (usize, &Point3)| Label { row, position_m, force_n: f64::NAN };
        (&self.frames, self.presses_m.iter().enumerate().map(label).collect())
    }

    /// The calibration of the presses so far; `None` below [`MIN_LABELS`].
    pub fn fit(&self) -> Option<SessionFit> {
        let (_, labels) = self.presses();
        (labels.len() >= MIN_LABELS).then(|| SessionFit {
            skin: self.skin.clone(),
            folder: self.folder.clone(),
            frames: self.frames.clone(),
            labels,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(skin: &Skin, number: usize) -> Frame {
        let at = |channel: usize| ((channel * (number + 1)) as f64 * 0.7).sin() / 3.0;
        Frame((0..skin.design().protocol.channel_count()).map(at).collect())
    }

    #[test]
    fn a_session_goes_on_where_it_was_and_takes_back_presses() {
        let skin = Skin::load("cylinder30").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let places = Places::spread(&skin, 12);
        let mut session = Session::open(&skin, folder.path(), places.clone()).unwrap();
        for number in 0..5 {
            assert_eq!(session.place(), Some(places.positions_m[number]));
            session.take(frame(&skin, number)).unwrap();
        }
        assert!(session.redo().unwrap());
        assert_eq!((session.taken(), session.place()), (4, Some(places.positions_m[4])));
        session.skip();
        assert_eq!(session.place(), Some(places.positions_m[5]));
        session.take(frame(&skin, 5)).unwrap();
        let covered = session.coverage();
        // Five of twelve places, each of which covers more than a twelfth.
        assert!(covered > 5.0 / 12.0 && covered < 0.95, "{covered}");
        assert!(session.fit().is_none());

        // A plan of more places has the same ones first.
        let mut again = Session::open(&skin, folder.path(), Places::spread(&skin, 20)).unwrap();
        assert_eq!((again.taken(), again.left(), again.place()), (5, 15, Some(places.positions_m[4])));
        assert_eq!((&again.frames, &again.presses_m), (&session.frames, &session.presses_m));
        for _ in 0..5 {
            assert!(again.redo().unwrap());
        }
        assert!(!again.redo().unwrap());
        assert!(!folder.path().join(FRAMES).exists());
    }

    #[test]
    fn files_that_do_not_belong_together_are_refused() {
        let skin = Skin::load("skin16").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let mut session = Session::open(&skin, folder.path(), Places::spread(&skin, 3)).unwrap();
        session.take(frame(&skin, 0)).unwrap();
        session.take(frame(&skin, 1)).unwrap();
        let frames = std::fs::read_to_string(folder.path().join(FRAMES)).unwrap();
        std::fs::write(folder.path().join(FRAMES), frames.lines().next().unwrap()).unwrap();
        let error = Session::open(&skin, folder.path(), Places::spread(&skin, 3)).unwrap_err().to_string();
        assert!(error.contains("frame 1 does not exist: the frames are 0 to 0"), "{error}");
        let other = Skin::load("cylinder30").unwrap();
        let error = Session::open(&other, folder.path(), Places::spread(&other, 3)).unwrap_err().to_string();
        assert!(error.contains("frames.csv") && error.contains("values"), "{error}");
    }
}
