"""A video of a run: the craft where they truly are, the light, and what each craft believes.

    craft, lighthouse   as their models say, at the true poses of the telemetry
    light               a beam from every station that stays where it is to every lit craft, in the colour of its
                        navigation's status; of the one lighthouse at the origin also the two fans as wedges, as wide as
                        the craft need, turning once in `FAN_TURN_S` (they turn 60 times a second)
    estimate            the axes x, y, z of the body (red, green, blue) at the estimated pose, its last seconds as a
                        track, and a ball of three standard deviations
    text                scenario, time, how many craft track, RMS errors

Of a replay, whose truth nobody knows, the object is at its estimate: its photodiodes, in a box about them, and once
more near by in a corner.

A video's picture shows the lighthouse period next to its time.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats
from estimators.rotation import matrix_from_quaternion, quaternion_from_matrix, quaternion_multiply
from swarm.assets import find_model
from swarm.errors import SwarmError
from swarm.exports.mp4 import Mp4, check_library
from swarm.flight.builders.stations import standing
from swarm.results.disk import outputs
from swarm.results.files import SCENARIO, TELEMETRY
from swarm.results.replayed import Replayed, read_replayed
from swarm.results.run_folder import open_run
from swarm.results.table import TelemetryTable
from swarm.scenario import Scenario, craft, load
from swarm.scenario.fleet import SingleCraft
from swarm.world.assembly import Standing, at_origin
from swarm.world.picture import FIELD_DEG, Mark, Picture, Plate, Subject, View, Wedge

FAN_TURN_S = 4.0
LEAST_FAN_DEG, MOST_FAN_DEG = 12.0, 55.0
"""Least and largest half angle of a fan that is drawn."""
TRACK_S = 4.0
"""Length of the tracks behind the craft."""
TRACK_STEPS = 24
MOST_OVERLAID = 64
"""Of more craft, only a dot and faint beams are drawn."""
COLOURS = {"tracking": (0.35, 0.9, 0.55), "single_sweeps": (0.55, 0.8, 0.95), "coasting": (0.95, 0.7, 0.25)}
"""Colours of beams and tracks by status; all others are red."""
BY_LIGHT = ("tracking", "single_sweeps")
LOST = (0.95, 0.3, 0.25)
LAMP = (1.0, 0.9, 0.6, 1.0)
"""Colour of a dot at each station, which is dark and small itself."""
AXES = ((0.95, 0.25, 0.25), (0.3, 0.85, 0.35), (0.35, 0.55, 1.0))
SIDE = np.array([0.62, -0.42, -0.66])
"""Direction from what is watched to the camera: from the right, above and behind the lighthouse."""
ROOM = 1.25
"""Room around what is watched."""
FROM_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Rotation from a frame with z up to one with -y up."""
INSET = 3
"""Width of a picture over that of the one in its corner."""
SIZES = (64, 4096)
"""Least and largest width and height of a video [px]."""


class Options(NamedTuple):
    """The looks of a video. speed: simulated seconds per second. width, height: of a picture [px]."""

    fps: int = 30
    speed: float = 1.0
    width: int = 1280
    height: int = 720


class Film:
    """The telemetry of a run as arrays (periods, craft, ...), NaN where nothing is known."""

    def __init__(self, folder: Path, replay: bool = False) -> None:
        """Read the run.

        Args:
            folder: Its folder.
            replay: The craft are where they believe to be.

        Raises:
            SwarmError: There is nothing to draw, or a file is damaged.
        """
        rows = TelemetryTable.of_run(folder)
        if not len(rows):
            raise SwarmError(f"{folder} has not one lighthouse period recorded: there is nothing to draw")
        self.names = rows.names_of("craft")
        frames, index = np.unique(rows.frame, return_inverse=True)
        self.shape = len(frames), len(self.names)
        self._place = index, rows.craft
        self.time_s: Floats = np.nanmax(self._grid(rows.column("time_s")), axis=1)
        self.believed, self.turned = (self._grid(each) for each in (rows.position("ekf"), rows.quaternion("ekf")))
        self.position, self.quaternion = (
            (self.believed, self.turned)
            if replay
            else (self._grid(each) for each in (rows.position("true"), rows.quaternion("true")))
        )
        if not replay and not np.isfinite(self.position).all():
            raise SwarmError(f"{folder} has no truth to draw, as a replay by an earlier version; swarm view shows it")
        if not np.isfinite(self.position).any():
            raise SwarmError(f"{folder} never had an estimate: there is nothing to draw")
        self.error_m, self.error_deg, self.sigma_m = (
            self._grid(rows.column(name)) for name in ("position_error_m", "attitude_error_deg", "position_sigma_m")
        )
        self.lit = self._grid(rows.column("visible")) > 0
        self._rows = rows
        words = rows.names_of("status")
        codes = self._grid(rows.column("status"))
        self.status = np.array([*words, ""])[np.where(np.isfinite(codes), codes, len(words)).astype(np.int64)]

    def lit_by(self, station: str) -> NDArray[np.bool_]:
        """Return whether the light of one of several stations went into the filters, (periods, craft)."""
        name = f"rows_{station}"
        if name not in self._rows.columns:
            name = "visible"
        lit: NDArray[np.bool_] = self._grid(self._rows.column(name)) > 0
        return lit

    def turn(self, rotation: Floats) -> None:
        """Turn all poses into another frame; rotation (3, 3) takes this frame to it."""
        q = quaternion_from_matrix(rotation)
        self.believed, self.turned = self.believed @ rotation.T, quaternion_multiply(q, self.turned)
        self.position, self.quaternion = self.position @ rotation.T, quaternion_multiply(q, self.quaternion)

    def _grid(self, flat: Any) -> Any:
        out = np.full((*self.shape, *flat.shape[1:]), np.nan)
        out[self._place] = flat
        return out


class Stage:
    """A run as it is drawn, as a context manager."""

    def __init__(self, path: str | Path, looks: Options) -> None:
        """Read the run in the folder `path`. Raises SwarmError where it cannot be read, or this machine cannot draw."""
        run = open_run(path)
        if not (run.folder / SCENARIO).is_file():
            raise SwarmError(f"{run.folder} was stopped before its {SCENARIO} was written")
        scenario, self._replayed = load(run.folder / SCENARIO), read_replayed(run.folder)
        self.film = film = Film(run.folder, self._replayed is not None)
        subjects = _subjects(scenario, film, run.folder) if self._replayed is None else []
        stations, several = _stations(scenario, self._replayed)
        if several and _up(scenario, self._replayed) == "z":
            # Pictures have -y upwards.
            film.turn(FROM_Z_UP)
            stations = [_turned(one) for one in stations]
        self._lamps = [Lamp(one.position, film.lit_by(one.name) if several else film.lit) for one in stations]
        self._field_deg = None if several else scenario.lighthouse.field_deg
        self._half_deg = half_angle_deg(scenario.lighthouse.field_deg, film.position)
        self._reach = float(np.nanmax(np.linalg.norm(film.position, axis=2)))
        self._view = view_of(film.position, [lamp.position for lamp in self._lamps], looks.width / looks.height)
        seen = np.concatenate([film.position[:, 0], *(lamp.position[None] for lamp in self._lamps)])
        self._low = low_corner(self._view, seen, looks.width / looks.height)
        away = float(np.linalg.norm(self._view.eye_m - self._view.target_m))
        self._pixel_m = 2 * np.tan(np.radians(FIELD_DEG / 2)) * away / looks.height
        navigates = np.ones(1, dtype=bool) if self._replayed is not None else _navigate(scenario)
        self._caption = _Caption(scenario, looks, self._replayed is not None, navigates)
        most = len(film.names) * (TRACK_STEPS + 6 + len(stations)) + 8
        most += 0 if self._replayed is None else 2 * len(self._replayed.point_m)
        self._picture = Picture(subjects, stations, looks.width, looks.height, most)

    def shot(self, time_s: float) -> NDArray[np.uint8]:
        """Return the picture of the period next to a time [s], (height, width, 3)."""
        film = self.film
        k = int(np.abs(film.time_s - time_s).argmin())
        marks = list(_marks(film, k, self._lamps, self._pixel_m))
        since_s = time_s - float(film.time_s[0])
        wedges = [] if self._field_deg is None else fans(self._field_deg, self._half_deg, self._reach, since_s)
        if self._replayed is None:
            drawn = self._picture.draw(film.position[k], film.quaternion[k], self._view, marks, wedges=wedges)
        else:
            drawn = self._object(self._replayed, k, marks, wedges)
        return self._caption.over(drawn, film, k)

    def _object(self, replayed: Replayed, k: int, marks: list[Mark], wedges: list[Wedge]) -> NDArray[np.uint8]:
        """Return the picture of a replay: the object as its photodiodes, and once more near by in a corner."""
        nothing, place = (np.zeros((0, 3)), np.zeros((0, 4))), self.film.believed[k, 0]
        if not np.isfinite(place).all():
            return self._picture.draw(*nothing, self._view, marks, wedges=wedges)
        turn = matrix_from_quaternion(self.film.turned[k, 0])
        ink = COLOURS.get(str(self.film.status[k, 0]), LOST)
        size = max(float(np.ptp(replayed.point_m, axis=0).max()), 0.01)
        body = [_box(replayed.point_m, place, turn)]
        far = [*marks, *_photodiodes(replayed, place, turn, max(0.02 * size, self._pixel_m), ink)]
        whole = self._picture.draw(*nothing, self._view, far, body, wedges)
        away = self._view.eye_m - self._view.target_m
        near = View(place + 2.6 * size * away / np.linalg.norm(away), place)
        close = list(_photodiodes(replayed, place, turn, 0.02 * size, ink))
        close += [Mark(place, place + 0.5 * size * turn[:, axis], 0.01 * size, (*AXES[axis], 1.0)) for axis in range(3)]
        inset = self._picture.draw(*nothing, near, close, body)
        return _in_corner(whole, inset, self._low)

    def __enter__(self) -> "Stage":
        return self

    def __exit__(self, *error: object) -> None:
        self._picture.close()


def video(
    path: str | Path, file: Path, options: Options | None = None, progress: Callable[[int, int], None] | None = None
) -> Path:
    """Draw a run, and return the video's file.

    Args:
        path: The folder of the run.
        file: The video, whose name ends in .mp4.
        options: Its looks.
        progress: Is told the pictures that are done, and all.

    Raises:
        SwarmError: The run cannot be read, this machine cannot draw, a library is missing, or nothing can be written.
    """
    looks = options or Options()
    _check(file, ".mp4", looks)
    check_library()
    with (
        Stage(path, looks) as stage,
        outputs(file) as (temporary,),
        Mp4(temporary, looks.width, looks.height, looks.fps) as written,
    ):
        times = np.arange(stage.film.time_s[0], stage.film.time_s[-1] + 1e-9, looks.speed / looks.fps)
        for number, time_s in enumerate(times.tolist()):
            written.add(stage.shot(time_s))
            if progress is not None:
                progress(number + 1, len(times))
    return file


def still(path: str | Path, file: Path, at_s: float | None = None, options: Options | None = None) -> Path:
    """Draw one picture of a run, and return its file.

    Args:
        path: The folder of the run.
        file: The picture, whose name ends in .png.
        at_s: The time [s]; None: the middle of the run.
        options: Its width and height.

    Raises:
        SwarmError: As `video`, or the time is not of the run.
    """
    from PIL import Image

    looks = options or Options()
    _check(file, ".png", looks)
    with Stage(path, looks) as stage:
        first, last = float(stage.film.time_s[0]), float(stage.film.time_s[-1])
        wanted = (first + last) / 2 if at_s is None else at_s
        if not first - 0.1 <= wanted <= last + 0.1:
            raise SwarmError(f"--at: {wanted:g} s is not in the run, which goes from {first:.2f} to {last:.2f} s")
        with outputs(file) as (temporary,):
            Image.fromarray(stage.shot(wanted)).save(temporary, optimize=True)
    return file


def _check(file: Path, ending: str, looks: Options) -> None:
    if file.suffix.lower() != ending:
        other = "; of a picture, in .png" if ending == ".mp4" else ""
        raise SwarmError(f"{file}: the name of a {'video' if ending == '.mp4' else 'picture'} ends in {ending}{other}")
    for name, value in (("width", looks.width), ("height", looks.height)):
        if value % 2 or not SIZES[0] <= value <= SIZES[1]:
            raise SwarmError(f"--size: the {name} {value} must be an even number from {SIZES[0]} to {SIZES[1]}")
    if not 1 <= looks.fps <= 120:
        raise SwarmError(f"--fps: {looks.fps} must be from 1 to 120")
    if not 0.01 <= looks.speed <= 1000:
        raise SwarmError(f"--speed: {looks.speed:g} must be from 0.01 to 1000")


def view_of(position: Floats, lamps: Sequence[Floats], ratio: float) -> View:
    """Return a camera that sees the lighthouse and every craft at all times.

    Args:
        position: Places of the craft, (periods, craft, 3) [m].
        lamps: Places of the stations, (3,) each [m].
        ratio: Width of a picture over its height.
    """
    points = np.concatenate(
        [position[:: max(len(position) // 200, 1)].reshape(-1, 3), *(place[None] for place in lamps)]
    )
    points = points[np.isfinite(points).all(axis=1)]
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    back = SIDE / np.linalg.norm(SIDE)
    right = np.cross([0.0, -1.0, 0.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    high = np.tan(np.radians(FIELD_DEG / 2))
    wide = high * ratio
    offset = points - middle
    # A point is inside the picture where its side is at most the field's at its distance.
    needed = offset @ back + ROOM * np.maximum(np.abs(offset @ right) / wide, np.abs(offset @ up) / high)
    return View(middle + max(float(needed.max()), 0.5) * back, middle)


class Lamp(NamedTuple):
    """A station: its place (3,) [m], and whose photodiodes it lights when, (periods, craft)."""

    position: Floats
    lit: NDArray[np.bool_]


def _subjects(scenario: Scenario, film: Film, folder: Path) -> list[Subject]:
    """Return the craft of a flight. Raises SwarmError where they are not those of the telemetry."""
    if tuple(film.names) != tuple(scenario.craft_names):
        raise SwarmError(f"{folder}: the craft in {SCENARIO} and in {TELEMETRY} are not the same")
    passive = [table.passive for _, table in scenario.tables]
    return [Subject(one.name, one.model, dark) for one, dark in zip(craft(scenario), passive, strict=True)]


def _navigate(scenario: Scenario) -> NDArray[np.bool_]:
    """Return which craft have photodiodes or cameras to navigate by, (craft,)."""
    by_cameras = [isinstance(table, SingleCraft) and table.ccd is not None for _, table in scenario.tables]
    by_light = [table.lighthouse and not table.passive for _, table in scenario.tables]
    out: NDArray[np.bool_] = np.array(by_cameras) | np.array(by_light)
    return out


def _stations(scenario: Scenario, replayed: Replayed | None) -> tuple[list[Standing], bool]:
    """Return the stations that stay where they are, and whether they are several in a frame of the world."""
    model = find_model(scenario.lighthouse.model)
    if replayed is not None and replayed.stations:
        poses = [(one.name, one.position, quaternion_from_matrix(one.rotation)) for one in replayed.stations]
        return [Standing(name, model, *pose) for name, *pose in poses], True
    several = None if replayed is not None else standing(scenario)
    return ([at_origin(model)], False) if several is None else (several, True)


def _up(scenario: Scenario, replayed: Replayed | None) -> str:
    return scenario.recording.up if replayed is None else replayed.up


def _turned(one: Standing) -> Standing:
    """Return a station of a frame with z up in one with -y up."""
    turn = quaternion_multiply(quaternion_from_matrix(FROM_Z_UP), one.quaternion)
    return one._replace(position=FROM_Z_UP @ one.position, quaternion=turn)


def _box(point_m: Floats, place: Floats, turn: Floats) -> Plate:
    """Return a box about an object's photodiodes."""
    low, high = point_m.min(axis=0), point_m.max(axis=0)
    return Plate(place + turn @ ((low + high) / 2), np.maximum((high - low) / 2, 0.001), turn, (0.75, 0.8, 0.9, 0.35))


def _photodiodes(
    replayed: Replayed, place: Floats, turn: Floats, radius_m: float, ink: tuple[float, float, float]
) -> Iterator[Mark]:
    """Yield an object's photodiodes as balls, each with a line in which it looks."""
    for point, normal in zip(replayed.point_m, replayed.normal, strict=True):
        at = place + turn @ point
        yield Mark(at, None, radius_m, (*ink, 1.0))
        yield Mark(at, at + turn @ normal * 4 * radius_m, 0.35 * radius_m, (*ink, 0.8))


def low_corner(view: View, points: Floats, ratio: float) -> bool:
    """Return whether fewer points are in the lower right corner of a picture than in the upper right one.

    Args:
        view: The picture's camera.
        points: Places, (N, 3) [m].
        ratio: Width of the picture over its height.
    """
    offset, ahead = points - view.eye_m, view.target_m - view.eye_m
    ahead = ahead / np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, -1.0, 0.0])
    right /= np.linalg.norm(right)
    scale = (offset @ ahead) * np.tan(np.radians(FIELD_DEG / 2))
    across, up = offset @ right / (scale * ratio), offset @ np.cross(right, ahead) / scale
    inside = across > 1 - 2 / INSET
    return int((inside & (up < 2 / INSET - 1)).sum()) < int((inside & (up > 1 - 2 / INSET)).sum())


def _in_corner(whole: NDArray[np.uint8], part: NDArray[np.uint8], low: bool) -> NDArray[np.uint8]:
    """Return a picture with a smaller one in its lower or upper right corner."""
    from PIL import Image

    image = Image.fromarray(whole)
    small = Image.fromarray(part).resize((image.width // INSET, image.height // INSET))
    left, top = image.width - small.width - 10, image.height - small.height - 10 if low else 10
    image.paste((90, 90, 90), (left - 2, top - 2, left + small.width + 2, top + small.height + 2))
    image.paste(small, (left, top))
    out: NDArray[np.uint8] = np.asarray(image)
    return out


def _marks(film: Film, k: int, lamps: Sequence[Lamp], pixel_m: float) -> Iterator[Mark]:
    """Yield the beams, and of not too many craft the estimates, in one period; lines are `pixel_m` wide or more."""
    few = film.shape[1] <= MOST_OVERLAID
    beam = 0.45 * min(1.0, (MOST_OVERLAID / film.shape[1]) ** 0.7)
    since = np.flatnonzero(film.time_s >= film.time_s[k] - TRACK_S)[0]
    past = np.unique(np.linspace(since, k, TRACK_STEPS + 1).round().astype(np.int64))
    size = 0.02 * float(np.linalg.norm(film.position[k], axis=1).max())
    yield from (Mark(lamp.position, None, 3 * pixel_m, LAMP) for lamp in lamps)
    for i in range(film.shape[1]):
        colour = COLOURS.get(str(film.status[k, i]), LOST)
        place, believed = film.position[k, i], film.believed[k, i]
        if np.isfinite(place).all():
            lit = [lamp.position for lamp in lamps if lamp.lit[k, i]]
            yield from (Mark(lamp, place, 0.7 * pixel_m, (*colour, beam)) for lamp in lit)
            if not few:
                yield Mark(place, None, 1.6 * pixel_m, (*colour, 1.0))
        if not few or not np.isfinite(believed).all():
            continue
        turn = matrix_from_quaternion(film.turned[k, i])
        for axis, ink in enumerate(AXES):
            yield Mark(believed, believed + 2.5 * size * turn[:, axis], 0.9 * pixel_m, (*ink, 1.0))
        if np.isfinite(film.sigma_m[k, i]):
            yield Mark(believed, None, 3 * float(film.sigma_m[k, i]), (*colour, 0.3))
        track = film.believed[past, i]
        for a, b in pairwise(track):
            if np.isfinite(a).all() and np.isfinite(b).all() and not np.array_equal(a, b):
                yield Mark(a, b, 0.6 * pixel_m, (*colour, 0.7))


def fans(field_deg: float, half_deg: float, reach: float, time_s: float) -> list[Wedge]:
    """Return the fan that sweeps, as a wedge from the lighthouse on: X, then Y, each from one side to the other.

    Args:
        field_deg: Full width of the lighthouse's field [deg].
        half_deg: Half angle of the wedge [deg].
        reach: Length of the wedge's sides [m].
        time_s: Time since the start [s].
    """
    field, half = np.radians(field_deg) / 2, np.radians(half_deg)
    out = []
    for fan, begin in enumerate((0.0, 0.5)):
        share = (time_s / FAN_TURN_S - begin) % 1.0
        if share >= 0.5:
            continue
        angle = field * (4 * share - 1)
        s, c = float(np.sin(angle)), float(np.cos(angle))
        # The fan's plane holds the direction at this angle from boresight, and the axis that the fan turns about.
        ahead = np.array([s, 0.0, c]) if fan == 0 else np.array([0.0, s, c])
        axle = np.array([0.0, 1.0, 0.0]) if fan == 0 else np.array([1.0, 0.0, 0.0])
        one, other = (reach * (np.cos(half) * ahead + side * np.sin(half) * axle) for side in (-1, 1))
        out.append(Wedge(np.zeros(3), (one, other), (1.0, 0.85, 0.4, 0.14)))
    return out


def half_angle_deg(field_deg: float, position: Floats) -> float:
    """Return the half angle [deg] of wedges, as seen from the lighthouse, that reach past all places (..., 3) [m].

    Args:
        field_deg: Full width of the lighthouse's field [deg], which no wedge leaves.
        position: Places of the craft; NaN where they are not known.
    """
    seen = position[np.isfinite(position).all(axis=-1) & (position[..., 2] > 0)]
    if not len(seen):
        return LEAST_FAN_DEG
    widest = float(np.degrees(np.arctan2(np.abs(seen[:, :2]).max(axis=1), seen[:, 2]).max()))
    return min(max(1.1 * widest, LEAST_FAN_DEG), field_deg / 2, MOST_FAN_DEG)


class _Caption:
    """The text in a picture's corners."""

    def __init__(self, scenario: Scenario, looks: Options, replay: bool, navigates: NDArray[np.bool_]) -> None:
        """Take what does not change. navigates: which craft have photodiodes or cameras, (craft,)."""
        from PIL import ImageFont

        self._navigates = navigates

        self._legend = "beam and track: green by light, orange coasting, red lost; "
        axes = "axes: estimate; " if len(navigates) <= MOST_OVERLAID else ""
        self._legend += "object at its estimate" if replay else f"{axes}fans slowed"

        size = max(looks.height // 36, 10)
        self._font: Any = ImageFont.load_default(size)
        self._margin, self._line = size, round(1.45 * size)
        self._title = f"{scenario.name}: {scenario.description}".rstrip(": ")
        self._speed = "" if looks.speed == 1 else f", {looks.speed:g} times as fast"

    def over(self, picture: NDArray[np.uint8], film: Film, k: int) -> NDArray[np.uint8]:
        """Return the picture with the text of a period."""
        from PIL import Image, ImageDraw

        image = Image.fromarray(picture)
        pen, height = ImageDraw.Draw(image), image.height
        lines = [self._title, f"{film.time_s[k]:.2f} s{self._speed}"]
        known = np.isfinite(film.error_m[k])
        by_light = int((np.isin(film.status[k], BY_LIGHT) & self._navigates).sum())
        below = [f"{by_light} of {int(self._navigates.sum())} craft navigate by light"]
        if known.any():
            rms = [np.sqrt(np.mean(each[k][known] ** 2)) for each in (film.error_m, film.error_deg)]
            below.append(f"error of the estimates, RMS: {1000 * rms[0]:.2f} mm, {rms[1]:.3f}°")
        below.append(self._legend)
        for i, text in enumerate(lines):
            self._write(pen, image.width, self._margin + i * self._line, text)
        for i, text in enumerate(below):
            self._write(pen, image.width, height - self._margin - (len(below) - i) * self._line, text)
        out: NDArray[np.uint8] = np.asarray(image)
        return out

    def _write(self, pen: Any, width: int, top: int, text: str) -> None:
        while text and pen.textlength(text, font=self._font) > width - 2 * self._margin:
            text = text[:-2].rstrip() + "…"
        pen.text((self._margin, top), text, font=self._font, fill=(225, 232, 240))
