"""The native part of `dermis`."""

from collections.abc import Sequence
from os import PathLike
from types import TracebackType
from typing import Any, Final, Literal, Self, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dermis._contacts import Contacts

__all__ = [
    "Calibration",
    "Dataset",
    "Frame",
    "Live",
    "Mesh",
    "Method",
    "Paired",
    "Pipeline",
    "Replay",
    "Robot",
    "RobotLive",
    "Samples",
    "Simulation",
    "Skin",
    "Solution",
    "Twin",
    "__version__",
    "commands_json",
    "contact_columns",
    "finish_dataset",
    "run_command",
    "run_program",
    "shipped_model",
]
__version__: Final[str]

def run_program(arguments: Sequence[str]) -> int:
    """Runs the program `dermis` with its arguments, the first of which is its name; returns the exit code."""

def run_command(arguments: Sequence[str]) -> None:
    """Runs the program `dermis` with its arguments; an error is raised, not printed."""

def shipped_model(name: str) -> tuple[bytes, bytes]:
    """The card (JSON) and the weights (safetensors) of a shipped network."""

def commands_json() -> str:
    """The commands of the program with their arguments: names, help, defaults, and the values that they take (JSON)."""

def contact_columns() -> dict[str, list[str]]:
    """The columns of the vectors of contacts in tables, by their names in arrays."""

def finish_dataset(folder: str | PathLike[str]) -> Dataset:
    """Checks every bit of the files of a folder and writes its manifest, as `dermis simulate --finish`.

    Raises:
        DermisError: Files that are missing or damaged.
    """

@final
class Paired:
    """A baseline with an untouched frame for each frame: `method.contacts(frames, dermis.Paired(untouched))`.

    For recordings that go up and down at each press: slow drift cancels.
    """

    def __new__(cls, baseline: ArrayLike) -> Self:
        """The untouched frames, (frames, channels), ohm: one for each frame, in the same order."""

@final
class Calibration:
    """A calibration of a real skin with measured presses. `Skin.calibrate` makes one.

    Gaussian processes: a forward map from positions to frames, or a correction of another method's contacts.
    """

    @property
    def name(self) -> str:
        """The calibrated method: `forward-map`, or the name of the method whose contacts are corrected."""

    @property
    def quality(self) -> dict[str, Any]:
        """What cross-validation on the labels states: errors in m, relative errors of forces."""

    def locate(
        self, frames: ArrayLike, baseline: ArrayLike | Paired | None = None, *, first: int = 0, force: bool = False
    ) -> dict[str, NDArray[Any]]:
        """Locates the press of each frame, in the order of recording. For forward maps.

        Args:
            frames: (n, channels), ohm.
            baseline: Untouched frames, (channels,) or (m, channels), ohm; without it, `frames` are differences.
            first: Number of the first frame in the recording of the labels.
            force: Go on with frames that cannot be those of the skin, or not of the baseline.

        Returns:
            Arrays by name: `position_m` (n, 3), `covariance_m2` (n, 3, 3), `sd_m`, `confidence`, `force_n`, `force_sd_n`,
            `misfit`, `unlike` (n,): whether a press is unlike every labelled one.

        Raises:
            DermisError: A wrong shape, a correction of a method, frames that cannot be those of the skin.
        """

    def suggest(self, count: int = 10) -> NDArray[np.float64]:
        """The positions whose presses would help a forward map most, (count, 3), m."""

    def method(self) -> Method:
        """The calibration as a reconstruction method."""

    def save(self, folder: str | PathLike[str]) -> None:
        """Writes the calibration to a folder, which `Skin.method` and `dermis live --method` read."""

@final
class Dataset:
    """A dataset in a folder, as `dermis simulate` writes it. Fields of samples: see `batch`."""

    def __new__(cls, folder: str | PathLike[str]) -> Self: ...
    @property
    def folder(self) -> Any:
        """The folder (a path)."""

    @property
    def manifest(self) -> dict[str, Any]:
        """Recipe, design, pixels, statistics, and the checksum of every file."""

    def __len__(self) -> int: ...
    def batch(self, indices: ArrayLike) -> dict[str, NDArray[Any]]:
        """The samples with some indices.

        Returns:
            Arrays by name: `index` (n,); `frame` and `rest` (n, channels), ohm: the frame during the touches, and the
            untouched frame of the same skin; `image` (n, pixels): relative change of conductance; `touches` (n, most, 6),
            NaN where there is none: x, y, z (m), then width (m) and amplitude of a Gaussian touch or tip radius (m) and
            force (N) of a press, and the strength (m2).

        Raises:
            DermisError: An index that does not exist, a file that has changed.
        """

@final
class Frame:
    """A frame of a pipeline, with its contacts."""

    @property
    def sequence(self) -> int:
        """Its number."""

    @property
    def time_s(self) -> float:
        """Time of measurement, s since 1970."""

    @property
    def values(self) -> NDArray[np.float64]:
        """The values, (channels,), ohm."""

    @property
    def image(self) -> NDArray[np.float64]:
        """The image, (rows, columns) with NaN outside the body, or (cells,)."""

    @property
    def validity(self) -> str:
        """`ok`, `degraded`, `invalid` or `stale`."""

    @property
    def reason(self) -> str:
        """The validity in words."""

    @property
    def is_usable(self) -> bool:
        """Whether the contacts can be relied on: the frame is ok or degraded."""

    @property
    def touched(self) -> bool | None:
        """Whether the skin is touched; None if the frame is invalid or stale."""

    @property
    def contacts(self) -> Contacts:
        """The tracked contacts, the oldest first."""

@final
class Live:
    """A skin that is being read: an iterator over frames. As a context manager it stops at the end of the block.

    Args:
        skin: The skin.
        source: `emulate` (a simulated device), tcp:HOST:PORT, serial:PATH[@BAUD], replay:FILE, or csv:..., as
            `dermis live --source`.
        method: Name or folder of the method; the best one of the skin without it.
        threshold: Detection threshold relative to the method's own.
        both_signs: Detect contacts that raise and contacts that lower the conductance. Linear methods only.
        twin: Twin of the simulated device: `ideal`, `lab`, `lab-b`, `lab-c`, `harsh`, or the path of a file.
        seed: Seed of the twin.
        touch: Touch script of the simulated device: none, random, press, slide, cross, four, grid, or a file.
        speed: Speed of the simulated device or of a recording, as a multiple of real time.
        all_frames: Give every frame, also those that have waited for the caller, of which at most 4,096 are kept. Without it
            frames that have waited for longer than 50 ms are skipped if newer ones wait. Recordings are given whole.

    Raises:
        DermisError: A device that cannot be reached or is refused.
    """

    def __new__(
        cls,
        skin: Skin,
        source: str = "emulate",
        method: str | PathLike[str] | None = None,
        *,
        threshold: float = 1.0,
        both_signs: bool = False,
        twin: str = "lab",
        seed: int = 1,
        touch: str = "none",
        speed: float = 1.0,
        all_frames: bool = False,
    ) -> Self: ...
    def __iter__(self) -> Self: ...
    def __next__(self) -> Frame: ...
    def __enter__(self) -> Self: ...
    def __exit__(self, *_exception: type[BaseException] | BaseException | TracebackType | None) -> None: ...
    def tare(self) -> None:
        """Measures the baseline again."""

    def notices(self) -> list[str]:
        """The messages since the last call: faults, parts that came back, a lost device."""

    def stop(self) -> None:
        """Stops reading."""

@final
class Mesh:
    """The mesh of a skin: triangles of a surface, or tetrahedra of a volume."""

    @property
    def nodes(self) -> NDArray[np.float64]:
        """Positions of the nodes, (nodes, 3), m."""

    @property
    def cells(self) -> NDArray[np.int64]:
        """The nodes of each cell: (cells, 3) for triangles, (cells, 4) for tetrahedra."""

    @property
    def measures(self) -> NDArray[np.float64]:
        """Areas of triangles, m2, or volumes of tetrahedra, m3: (cells,)."""

    @property
    def electrode_nodes(self) -> list[NDArray[np.int64]]:
        """The nodes of each electrode."""

    def to_meshio(self, cell_data: dict[str, ArrayLike] | None = None) -> Any:
        """The mesh as a `meshio.Mesh`, with values per cell by name. Needs meshio."""

@final
class Method:
    """A reconstruction method prepared for a skin. `Skin.method` makes one."""

    @property
    def name(self) -> str:
        """The name by which it is selected: `noser`, `spots`, `./my-model`."""

    @property
    def label(self) -> str:
        """Its name in words."""

    @property
    def alpha(self) -> float | None:
        """The regularization parameter of a linear method, else None."""

    def images(
        self, frames: ArrayLike, baseline: ArrayLike | Paired | None = None, *, force: bool = False
    ) -> NDArray[np.float64]:
        """Images of frames: relative changes of conductance, positive for touches.

        Args:
            frames: (channels,) or (n, channels), ohm.
            baseline: Untouched frames, (channels,) or (m, channels), ohm: their mean is subtracted. Without it,
                `frames` are differences from the untouched skin.
            force: Go on with frames that cannot be those of the skin, or not of the baseline.

        Returns:
            (n, rows, columns), NaN outside the body, or (n, cells) for designs without a grid; without the first
            dimension for one frame of shape (channels,).

        Raises:
            DermisError: A wrong shape, a value that is not finite.
        """

    def to_xarray(self, frames: ArrayLike, baseline: ArrayLike | Paired | None = None) -> Any:
        """Images as an `xarray.DataArray` with the positions of the pixels as coordinates. Needs xarray.

        Args:
            frames: (channels,) or (n, channels), ohm.
            baseline: Untouched frames; without it, `frames` are differences.

        Returns:
            Dimensions `frame`, `row`, `column` (or `frame`, `pixel` for designs without a grid) with the coordinates
            `x_m`, `y_m`, `z_m`, NaN outside the body.
        """

    def contacts(
        self, frames: ArrayLike, baseline: ArrayLike | Paired | None = None, *, both_signs: bool = False, force: bool = False
    ) -> Contacts:
        """The contacts in frames.

        Args:
            frames: (channels,) or (n, channels), ohm.
            baseline: Untouched frames, (channels,) or (m, channels), ohm: their mean is subtracted. With 8 or more,
                the noise is measured from their scatter. Without it, `frames` are differences.
            both_signs: Detect contacts that raise and contacts that lower the conductance. Linear methods only.
            force: Go on with frames that cannot be those of the skin, or not of the baseline.

        Raises:
            DermisError: A wrong shape, a value that is not finite, frames that are not those of the skin.
        """

    def score(
        self, frames: ArrayLike, truth: Contacts | ArrayLike, baseline: ArrayLike | Paired | None = None, *, force: bool = False
    ) -> dict[str, Any]:
        """The score of the contacts in frames against true touches, as `dermis evaluate --json` prints it.

        Args:
            frames: (n, channels), ohm.
            truth: Contacts with `frame` and `position_m` (and `force_n`), or the positions of one touch in each frame,
                (n, 3), m.
            baseline: Untouched frames; without it, `frames` are differences.
            force: Go on with frames that cannot be those of the skin, or not of the baseline.

        Raises:
            DermisError: A wrong shape, a touch in a frame that does not exist, or off the skin.
        """

    def svg(self, frame: ArrayLike, baseline: ArrayLike | Paired | None = None) -> str:
        """The image of a frame with its contacts, as the text of an SVG."""

    @property
    def skin(self) -> Skin:
        """The skin."""

@final
class Pipeline:
    """The pipeline of a live skin, for frames of one's own: baseline, drift, faults, tracked contacts.

    The first `tare_frames` frames are untouched ones: their mean is the baseline.

    Args:
        skin: The skin.
        method: Name or folder of the method; the best one of the skin without it.
        threshold: Detection threshold relative to the method's own.
        tare_frames: Number of frames of a tare.
        both_signs: Detect contacts that raise and contacts that lower the conductance. Linear methods only.
        force: Tare with frames that are unlike the model of the design, or that are all the same, as those of a
            simulation without noise.

    Raises:
        DermisError: An unknown method, a setting out of its range.
    """

    def __new__(
        cls,
        skin: Skin,
        method: str | PathLike[str] | None = None,
        *,
        threshold: float = 1.0,
        tare_frames: int = 100,
        both_signs: bool = False,
        force: bool = False,
    ) -> Self: ...
    def process(self, frame: ArrayLike, time_s: float | None = None) -> Frame:
        """Processes the next frame.

        Args:
            frame: (channels,), ohm.
            time_s: Time of measurement, s since 1970; now without it. Times increase.
        """

    def tare(self) -> None:
        """Measures the baseline again, from the next frames."""

    def notices(self) -> list[str]:
        """The messages since the last call: what was masked, what came back."""

@final
class Replay:
    """A recording whose contacts are computed again: an iterator over frames.

    Args:
        path: A recording (MCAP) of `dermis live --record`.
        method: Folder of the network of the recording, unless it is a shipped one.

    Raises:
        DermisError: A file that is not a recording; while iterating, a damaged part, after which it goes on.
    """

    def __new__(cls, path: str | PathLike[str], *, method: str | PathLike[str] | None = None) -> Self: ...
    @property
    def skin(self) -> Skin:
        """The skin of the recording."""

    def __iter__(self) -> Self: ...
    def __next__(self) -> Frame: ...

@final
class Robot:
    """Several skins on the links of one robot: contacts in its frame, wrenches, joint torques, rules.

    Frames come from a `Pipeline` or `Live` of each skin, joint positions from the robot's controller. What has not been fed for
    the `age_s` of the file is unknown, never clear.

    Args:
        path: File of the robot (TOML), as of `dermis robot`.

    Raises:
        DermisError: A file that is wrong, with the line and the fix.
    """

    def __new__(cls, path: str | PathLike[str]) -> Self: ...
    @property
    def name(self) -> str:
        """Its name."""

    @property
    def base(self) -> str | None:
        """The link whose frame is the base; None without a robot description."""

    @property
    def skins(self) -> dict[str, str]:
        """The designs of its skins, by name, in the order of the file."""

    @property
    def skin_links(self) -> dict[str, str]:
        """The links that wear its skins, by name of the skin."""

    @property
    def skin_methods(self) -> dict[str, str | None]:
        """The methods of its skins, by name; None for the best one of the skin."""

    def origin(self, skin: str) -> NDArray[np.float64]:
        """The pose of a skin's frame in that of its link, (4, 4), m.

        Args:
            skin: Name of the skin.
        """

    @property
    def links(self) -> list[str]:
        """Its links."""

    @property
    def joint_names(self) -> list[str]:
        """The joints that have positions, in the order of the columns of Jacobians."""

    def joints(self, positions: dict[str, float], time_s: float | None = None) -> None:
        """Takes joint positions, rad or m, by name.

        Args:
            positions: Every joint between the base and a skin; others may be there.
            time_s: Time of measurement, s since 1970; now without it.

        Raises:
            DermisError: A position that is not finite, a joint that is missing or that jumped, a time before the last one.
        """

    def feed(self, skin: str, frame: Frame, time_s: float | None = None) -> list[dict[str, Any]]:
        """Takes a frame of a skin; returns the rules that begin, end or change their reason by it.

        Args:
            skin: Name of the skin.
            frame: A frame of its `Pipeline` or `Live`.
            time_s: The time now, s since 1970; that of the clock without it.
        """

    def tick(self, time_s: float | None = None) -> list[dict[str, Any]]:
        """Lets time pass: frames become too old, rules end. Returns the rules that begin, end or change their reason.

        Args:
            time_s: The time now, s since 1970; that of the clock without it.
        """

    def snapshot(self, time_s: float | None = None) -> dict[str, Any]:
        """What is known now: `touched` (None if unknown), `unknown`, `skins`, `contacts`, `wrenches`, `joint_torques`, `rules`.

        The fields are those of the lines of `dermis robot run --jsonl -`.

        Args:
            time_s: The time now, s since 1970; that of the clock without it.
        """

    def pose(self, link: str, positions: dict[str, float]) -> NDArray[np.float64]:
        """The pose of a link in the base's frame, (4, 4), m.

        Args:
            link: Name of the link.
            positions: Positions of joints, rad or m, by name.
        """

    def jacobian(
        self, link: str, positions: dict[str, float], point_m: tuple[float, float, float] | None = None
    ) -> NDArray[np.float64]:
        """The Jacobian of a point of a link, (6, joints): velocity of the point over angular velocity of the link, in the base's frame.

        Args:
            link: Name of the link.
            positions: Positions of joints, rad or m, by name.
            point_m: The point in the link's frame, m; its origin without it.
        """

    def live(
        self,
        *,
        emulate: bool = False,
        rate_hz: float = 50.0,
        record: str | PathLike[str] | None = None,
        share: str | None = None,
        twin: str = "lab",
        touch: str = "none",
    ) -> RobotLive:
        """Reads all skins, as `dermis robot run`.

        Args:
            emulate: Simulate all devices, and joints that move slowly unless the file names a source of joint states.
            rate_hz: Snapshots per second, 0.1 to 1000.
            record: A new folder for a recording, for `dermis robot replay`.
            share: The address, `HOST:PORT` of this machine, at which the skins are shared with the program of the whole robot.
            twin: Twin of simulated devices: `ideal`, `lab`, `lab-b`, `lab-c`, `harsh`, or the path of a file.
            touch: Touch script of simulated devices: none, random, press, slide, cross, four, grid, or a file.

        Raises:
            DermisError: A method that cannot be prepared, a source that is no address, a folder that is there already. Devices that
                are not there are waited for.
        """

@final
class RobotLive:
    """A robot whose skins are being read: an iterator over what it says. As a context manager it stops at the end of the block.

    Each item is a dictionary with one key: `"event"`, what happens to a rule (`begins`, `changes` for another reason, `ends`), as of `Robot.feed`, at once; or `"snapshot"`, as of
    `Robot.snapshot`. `Robot.live` makes one.
    """

    def __iter__(self) -> Self: ...
    def __next__(self) -> dict[str, Any]: ...
    def __enter__(self) -> Self: ...
    def __exit__(self, *_exception: type[BaseException] | BaseException | TracebackType | None) -> None: ...
    def joints(self, positions: dict[str, float], time_s: float | None = None) -> None:
        """Takes joint positions, rad or m, by name, as `Robot.joints`. Simulated joints do not move any more then.

        Args:
            positions: Every joint between the base and a skin; others may be there.
            time_s: Time of measurement, s since 1970; now without it.

        Raises:
            DermisError: Those of `Robot.joints`.
        """

    def tare(self, skin: str | None = None) -> None:
        """Measures the baseline of a skin again, or of all.

        Args:
            skin: Name of the skin; all without it.

        Raises:
            DermisError: A skin that the robot does not have.
        """

    def notices(self) -> list[str]:
        """The messages since the last call: faults, skins that came back, swapped cables."""

    def stop(self) -> None:
        """Stops reading.

        Raises:
            DermisError: A recording that is not complete.
        """

@final
class Samples:
    """Training samples of a recipe, computed when they are asked for. `Skin.samples` makes one.

    Sample i depends on the seed and on i alone: it is the same as in the files of `dermis simulate`.
    """

    @property
    def seed(self) -> int:
        """The seed."""

    def batch(self, first: int, count: int) -> dict[str, NDArray[Any]]:
        """The samples `first` to `first + count`: arrays as of `Dataset.batch`."""

@final
class Simulation:
    """A dataset that is generated into a folder; its files are those of `dermis simulate`. `Skin.simulation` makes one."""

    @property
    def samples(self) -> int:
        """Number of samples."""

    @property
    def files(self) -> int:
        """Number of files: 8,192 samples each, fewer in the last."""

    def begin(self, folder: str | PathLike[str]) -> list[int]:
        """Starts the dataset in a folder, which is created, or checks the dataset that is there.

        Returns:
            The numbers of the missing files.

        Raises:
            DermisError: A folder that cannot be written, or with another dataset; a disk that is too small.
        """

    def run(
        self,
        folder: str | PathLike[str],
        shard: tuple[int, int] = ...,
        *,
        threads: int | None = None,
        wait: bool = False,
    ) -> int:
        """Generates the missing files of a shard. Any number of processes may share the folder. `finish_dataset` follows.

        Args:
            folder: The folder.
            shard: (i, n): the files k with k mod n = i; all files, (0, 1), without it.
            threads: Number of threads; those of the machine without it.
            wait: Wait for files that other processes are generating, and generate those that they leave.

        Returns:
            The number of generated samples.

        Raises:
            DermisError: As `begin`; without `wait`, files that other processes are generating, after the others are written.
        """

@final
class Skin:
    """A skin prepared for computing: design, mesh, forward model. It can be pickled."""

    @staticmethod
    def load(design: str | PathLike[str] | dict[str, Any]) -> Skin:
        """Prepares the skin of a design.

        Args:
            design: A shipped name (`Skin.shipped()`), the path of a design file, or a dict with the keys of one; arrays are
                lists.

        Raises:
            DermisError: A design that cannot be read, meshed or solved; `line`, `field` and `hint` say where.
        """

    @staticmethod
    def parse(text: str, path: str = "design") -> Skin:
        """Prepares the skin of the text of a design file; relative paths in it start from the folder of `path`."""

    @staticmethod
    def shipped() -> list[str]:
        """The names of the shipped designs."""

    @property
    def name(self) -> str:
        """Name of the design."""

    @property
    def design(self) -> str | None:
        """The text of the design file."""

    @property
    def electrodes(self) -> NDArray[np.float64]:
        """Centres of the electrodes, (electrodes, 3), m."""

    @property
    def channels(self) -> NDArray[np.int64]:
        """The electrodes of each channel, (channels, 4): source, sink, plus, minus."""

    @property
    def mesh(self) -> Mesh:
        """The mesh of the forward model."""

    @property
    def rest_conductivity(self) -> NDArray[np.float64]:
        """Conductivity of each cell of the untouched skin, (cells,): S on surfaces, S/m in volumes."""

    @property
    def pixels(self) -> NDArray[np.float64]:
        """Centres of the pixels of images, (pixels, 3), m."""

    @property
    def methods(self) -> list[str]:
        """Names of the reconstruction methods, the best first."""

    def forward(self, conductivity: ArrayLike | None = None) -> NDArray[np.float64]:
        """Frames of conductivities.

        Args:
            conductivity: (cells,) or (n, cells): S on surfaces, S/m in volumes. The untouched skin without it.

        Returns:
            (channels,) or (n, channels), ohm: amplitudes if the instrument of the design loses the signs.

        Raises:
            DermisError: A wrong shape, a value that is not positive and finite.
        """

    def solve(
        self,
        conductivity: ArrayLike,
        *,
        contact_impedance: ArrayLike | None = None,
        nodes: ArrayLike | None = None,
    ) -> Solution:
        """Frames of conductivities that can be differentiated.

        Args:
            conductivity: (cells,) or (n, cells): S on surfaces, S/m in volumes.
            contact_impedance: (electrodes,): ohm m2 on areas, ohm m on edges; that of the design without it.
            nodes: Positions of the nodes, (nodes, 3), m; those of `mesh` without it.

        Raises:
            DermisError: A wrong shape, a value that is not positive and finite.
        """

    @property
    def contact_impedance(self) -> NDArray[np.float64]:
        """Contact impedance of each electrode, (electrodes,): ohm m2 on areas, ohm m on edges."""

    def jacobian(
        self, conductivity: ArrayLike | None = None, *, per: Literal["pixel", "cell"] = "pixel"
    ) -> NDArray[np.float64]:
        """The Jacobian of a frame with respect to conductivity; of voltages with their signs for every instrument.

        Args:
            conductivity: (cells,). The untouched skin without it: computed once, then the same read-only array.
            per: Meaning of the columns.

        Returns:
            (channels, pixels) or (channels, cells), ohm per S.

        Raises:
            DermisError: A wrong shape, a value that is not positive and finite.
        """

    def touched_conductivity(
        self, positions: ArrayLike, *, amplitude: float = 0.5, width_m: float = 0.008
    ) -> NDArray[np.float64]:
        """The conductivity of each cell with Gaussian touches.

        Args:
            positions: Centres of the touches, (3,) or (touches, 3), m.
            amplitude: Relative change of conductance at the centres: 1 doubles it.
            width_m: Standard deviation along the surface, m.

        Returns:
            (cells,)

        Raises:
            DermisError: An amplitude or width that is not positive.
        """

    def method(self, name: str | PathLike[str] | None = None, *, alpha: float | None = None) -> Method:
        """Prepares a reconstruction method.

        Args:
            name: One of `methods`, or the folder of a trained network or a calibration; the best one without it.
            alpha: Regularization parameter of a linear method.

        Raises:
            DermisError: An unknown name, a method that does not fit the skin.
        """

    def twin(self, name: str | PathLike[str] | None = None, *, seed: int) -> Twin:
        """A digital twin of the skin.

        Args:
            name: `ideal`, `lab`, `lab-b`, `lab-c` or `harsh`, or the path of a twin file; `lab` without it.
            seed: Seed of the twin's errors and noise.

        Raises:
            DermisError: A twin that does not fit the skin.
        """

    def experiment(
        self, name: str | PathLike[str] | None = None, *, seed: int
    ) -> dict[str, dict[str, Any]]:
        """The paper's indentation experiment on a twin, as `dermis experiment` writes it.

        Args:
            name: `ideal`, `lab`, `lab-b`, `lab-c` or `harsh`, or the path of a twin file; `lab` without it.
            seed: Seed of the twin, the presses and the noise.

        Returns:
            Sets of presses by name, each with `frames` (n, channels), `baseline` (untouched frames) and `truth` (Contacts).
        """

    def calibrate(
        self,
        frames: ArrayLike,
        positions: ArrayLike,
        baseline: ArrayLike | Paired | None = None,
        *,
        force_n: ArrayLike | None = None,
        rows: ArrayLike | None = None,
        method: str | None = None,
        robot_frame: bool = False,
        force: bool = False,
    ) -> Calibration:
        """Calibrates the skin with measured presses, as `dermis calibrate`.

        Args:
            frames: One press in each row, (n, channels), ohm, in the order of recording.
            positions: Positions of the presses, (labels, 3), m.
            baseline: Untouched frames; without it, `frames` are differences.
            force_n: Forces, (labels,), N.
            rows: The row of `frames` of each press, (labels,); 0, 1, 2, ... without it. Frames without a press are used
                without their positions.
            method: `forward-map`, or the name of a method whose contacts are corrected; the better one without it.
            robot_frame: The positions are in a robot's frame, in which the pose of the skin is estimated. Flat skins only.
            force: Go on with frames that do not fit their baseline, and with a calibration that is worse than none.

        Raises:
            DermisError: Too few presses, positions off the skin, frames that cannot be those of the skin, and without
                `force` a calibration that is worse than none.
        """

    def calibration(self, folder: str | PathLike[str]) -> Calibration:
        """Reads a calibration of this skin from its folder."""

    def samples(self, recipe: str | PathLike[str] | dict[str, Any], seed: int) -> Samples:
        """Training samples of a recipe.

        Args:
            recipe: The path of a recipe file (docs/datasets.md), or a dict with its keys.
            seed: The seed.

        Raises:
            DermisError: A recipe from which no sample can be drawn.
        """

    def simulation(self, recipe: str | PathLike[str] | dict[str, Any], seed: int, samples: int) -> Simulation:
        """The generation of a dataset of a recipe's samples, as `dermis simulate`.

        Args:
            recipe: The path of a recipe file (docs/datasets.md), or a dict with its keys.
            seed: The seed.
            samples: Number of samples.

        Raises:
            DermisError: A recipe from which no sample can be drawn.
        """

    def svg(self, what: Literal["electrodes", "mesh", "sensitivity"] = "electrodes") -> str:
        """A picture of the skin, as the text of an SVG."""

@final
class Solution:
    """Frames of conductivities, with what their gradients need. `Skin.solve` makes one."""

    @property
    def frames(self) -> NDArray[np.float64]:
        """The frames, (n, channels) or (channels,), ohm; read-only."""

    def gradient(self, by_frame: ArrayLike, *, parameters: bool = False) -> dict[str, NDArray[np.float64]]:
        """The gradients of functions of the frames, in reverse mode: the transposed Jacobian times `by_frame`.

        Args:
            by_frame: Derivative of a function with respect to each value of its frame, of the shape of `frames`.
            parameters: Also differentiate with respect to contact impedances and nodes.

        Returns:
            Arrays by name: `conductivity`, of the shape of the conductivities; with `parameters` also
            `contact_impedance` (electrodes,) and `nodes` (nodes, 3), summed over the frames.

        Raises:
            DermisError: A wrong shape.
        """

@final
class Twin:
    """A digital twin: one skin with manufacturing errors, foam, electronics and noise, all drawn from a seed.

    `Skin.twin` makes one. Frames are numbered in the time of the twin: drift and noise depend on the number.
    """

    @property
    def name(self) -> str:
        """Name of the options."""

    @property
    def seed(self) -> int:
        """The seed."""

    @property
    def frame_rate_hz(self) -> float:
        """Frames per second."""

    def untouched(self, count: int = 100, *, first: int = 0) -> NDArray[np.float64]:
        """Untouched frames, (count, channels), ohm, from frame `first` on."""

    def press(
        self,
        positions: ArrayLike,
        *,
        force_n: ArrayLike | None = None,
        tip_radius_m: ArrayLike | None = None,
        frame: ArrayLike | None = None,
        first: int = 100,
    ) -> NDArray[np.float64]:
        """Frames of presses.

        Args:
            positions: Where the axes of the tips meet the skin, (presses, 3), m.
            force_n: Forces, a number or (presses,), N; 2 without it.
            tip_radius_m: Radii of the spherical tips, a number or (presses,), m; 0.005 without it.
            frame: The frame of each press, (presses,): presses of one frame act together. Each in its own without it.
            first: Number of the first frame.

        Returns:
            (frames, channels), ohm.

        Raises:
            DermisError: A press off the skin, a force that is not positive.
        """
