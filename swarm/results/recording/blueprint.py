"""Layout of the viewer: the scene large on the left, plots on the right, a legend behind a tab."""

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from estimators.arrays import Floats
from estimators.relative_orbit import EARTH_RADIUS_M
from swarm.results.recording.orbit import UNIT_M
from swarm.results.recording.plots import Plot
from swarm.results.scene import OrbitScene

MOST_LANES = 6
"""Lanes of states that have room below the scene; of more, the others are scrolled to."""
MOST_NAMED = 5
"""Lines of a plot that its legend has room for."""
LANE_PX, LANES_HEAD_PX, SCREEN_PX = 41, 62, 940
"""Heights of a lane with its name, of the panel's title and axis, and of the viewer's middle on a usual screen."""
NOT_TO_POINT_AT = ("world/rays", "world/names", "world/trails", "world/fans", "world/light")


def _view(plot: Plot) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=plot.entity,
        name=plot.title,
        plot_legend=rrb.PlotLegend(corner="RightTop", visible=len(plot.lines) <= MOST_NAMED),
    )


def _column(plots: Sequence[Plot], name: str) -> rrb.Vertical:
    """Put plots below each other; ADOP and PDOP side by side."""
    views: list[rrb.Container | rrb.View] = []
    shares: list[float] = []
    for plot in plots:
        if plot.entity == "swarm/pdop":
            views[-1] = rrb.Horizontal(views[-1], _view(plot))
        else:
            views.append(_view(plot))
            shares.append(3.0 if "error" in plot.entity else 2.0)
    return rrb.Vertical(*views, row_shares=shares, name=name)


def _eye(position: Floats, up: str, lighthouse: bool) -> rrb.EyeControls3D:
    """Look from the right, above and behind the lighthouse: it is on the left, the craft (n, 3) [m] on the right.

    Args:
        position: Places that are to be seen, (n, 3) [m].
        up: Axis of the world that points up, "-y" or "z".
        lighthouse: The one lighthouse stands at the origin, and is to be seen, too.
    """
    points = np.concatenate([np.zeros((1, 3)), position]) if lighthouse or not len(position) else position
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = max(0.5, float(np.linalg.norm(points - centre, axis=1).max()))
    direction = np.array([0.80, -0.42, -0.55]) if up == "-y" else np.array([0.60, -0.62, 0.50])
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=centre + 1.9 * radius * direction / np.linalg.norm(direction),
        look_target=centre,
        eye_up=(0, -1, 0) if up == "-y" else (0, 0, 1),
    )


def _orbit(orbit: OrbitScene) -> rrb.Spatial3DView:
    """Return the view of the orbit: from above its plane, the lighthouse in front, and the night to be seen."""
    reach = 2.5 * (EARTH_RADIUS_M + orbit.altitude_m) / UNIT_M
    azimuth = np.radians(30.0)
    if orbit.sun_phase_rad is not None:
        around = np.radians(np.arange(-50.0, 51.0, 5.0))
        away = np.abs((around - orbit.sun_phase_rad + np.pi) % (2 * np.pi) - np.pi)
        azimuth = around[np.argmin(np.abs(away - np.radians(80.0)))]
    direction = np.array([np.cos(azimuth), np.sin(azimuth), 0.55])
    return rrb.Spatial3DView(
        origin="orbit",
        name="Orbit, 1000 km",
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=reach * direction / np.linalg.norm(direction),
            look_target=np.zeros(3),
            eye_up=(0, 0, 1),
        ),
        line_grid=rrb.LineGrid3D(visible=False),
        background=[13, 17, 23],
        overrides={"orbit/earth": rrb.EntityBehavior(interactive=False)},
    )


def blueprint(
    swarm: Sequence[Plot],
    single: Mapping[str, Sequence[Plot]],
    position: Floats,
    lanes: int,
    live: bool,
    up: str = "-y",
    lighthouse: bool = True,
    orbit: OrbitScene | None = None,
) -> rrb.Blueprint:
    """Return the layout.

    Args:
        swarm: Plots of all craft.
        single: Plots of single craft, by name.
        position: Places of the craft at the start, (n, 3) [m], at which the camera is aimed.
        lanes: Number of lanes of states.
        live: The viewer follows a run that goes on.
        up: Axis of the world that points up, "-y" or "z".
        lighthouse: The one lighthouse stands at the origin.
        orbit: The lighthouse's orbit, which has a view of its own; None in weightless space.
    """
    low = 1.0 + (float(position[:, 1].max()) if len(position) else 0.0)
    floor = (0.0, 1.0, 0.0), low
    if up == "z":
        floor = (0.0, 0.0, 1.0), min(float(position[:, 2].min()) if len(position) else 0.0, 0.0)
    scene = rrb.Spatial3DView(
        origin="world",
        name="Lighthouse and craft",
        eye_controls=_eye(position, up, lighthouse),
        line_grid=rrb.LineGrid3D(
            spacing=1.0, plane=rr.components.Plane3D(*floor), color=[120, 130, 150, 70], stroke_width=1.0
        ),
        background=[13, 17, 23],
        overrides={entity: rrb.EntityBehavior(interactive=False) for entity in NOT_TO_POINT_AT},
    )
    panel_px = LANES_HEAD_PX + LANE_PX * min(lanes, MOST_LANES)
    status = rrb.StateTimelineView(origin="status", name="Status")
    about = rrb.TextDocumentView(origin="about", name="What is what")
    columns = [_column(swarm, "Swarm"), *(_column(plots, name) for name, plots in single.items())]
    plots = rrb.Tabs(*columns, about, active_tab=0)
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(scene, status, row_shares=[SCREEN_PX - panel_px, panel_px]) if lanes else scene,
            plots if orbit is None else rrb.Vertical(_orbit(orbit), plots, row_shares=[1, 2]),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(timeline="sim_time", state="collapsed", play_state="following" if live else "playing"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TopPanel(state="expanded"),
    )
