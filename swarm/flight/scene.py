"""What a run's telemetry and recording are told of a flight before its first period."""

from collections.abc import Sequence

from swarm.assets import find_model
from swarm.flight.dynamics import Dynamics
from swarm.hardware import Photodiodes
from swarm.onboard.inspection import Inspection
from swarm.results.recording.scene import CcdScene, Scene
from swarm.scenario import Scenario
from swarm.sensors.ccd import CcdSettings
from swarm.world.craft import visuals


def scene(
    scenario: Scenario,
    dynamics: Dynamics,
    layout: Photodiodes,
    pairs: Sequence[CcdSettings],
    inspection: Inspection | None,
    faults: Sequence[str],
) -> Scene:
    """Return the scene of a flight.

    Args:
        scenario: What is flown.
        dynamics: The world, and what moves the craft.
        layout: The photodiodes on board.
        pairs: The pairs of cameras.
        inspection: The computers of the craft with LiDARs.
        faults: Names of what may fail, empty without faults.
    """
    world, limits = dynamics.world, scenario.navigation.integrity
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
                pair.field_rad,
            )
            for pair in pairs
        ],
        lidar=[(o.craft, o.target) for o in inspection.observers] if inspection is not None else (),
        watched=bool(faults) or limits.alert_position_mm is not None or limits.alert_attitude_deg is not None,
        actuated=dynamics.actuators.fitted,
        guided=dynamics.guided.guides,
        docking=dynamics.guided.docks,
        faults=faults,
    )
