"""What a run's telemetry and recording are told of a flight before its first period."""

from collections.abc import Sequence

from swarm.assets import find_model
from swarm.hardware import Photodiodes
from swarm.onboard.inspection import Inspection
from swarm.results.columns.extra import Extra
from swarm.results.recording.scene import CcdScene, Scene
from swarm.scenario import Scenario
from swarm.sensors.ccd import Pair
from swarm.world.craft import visuals
from swarm.world.world import World


def scene(
    scenario: Scenario,
    world: World,
    layout: Photodiodes,
    pairs: Sequence[Pair],
    inspection: Inspection | None,
    extra: Sequence[Extra],
) -> Scene:
    """The scene of a flight. layout: the photodiodes on board. pairs: of cameras. extra: its telemetry's columns."""
    return Scene(
        craft=world.names,
        visuals=[world.visuals(i) for i in range(layout.craft_count)],
        photodiodes=layout,
        lighthouse=visuals(find_model(scenario.lighthouse.model)),
        field_deg=scenario.lighthouse.field_deg,
        detail=scenario.recording.detail,
        ccd=[
            CcdScene(
                pair.craft,
                pair.target,
                pair.cameras.position_m,
                pair.cameras.rotation,
                pair.lights.point_m,
                pair.settings.field_rad,
            )
            for pair in pairs
        ],
        lidar=[(o.craft, o.target) for o in inspection.observers] if inspection is not None else (),
        extra=extra,
    )
