"""A replay's solutions against the poses that came with the recording."""

from typing import Any

import numpy as np

from estimators.rotation import angle_between, matrix_from_quaternion, mean_rotation
from swarm.results.table import TelemetryTable


def peer_scatter(rows: TelemetryTable, source: str = "pnp") -> dict[str, Any]:
    """Return how far the peer's pose is from the PnP solution, a constant offset in the body frame removed.

    source: "pnp", or whose poses to take instead: "ekf", "smooth".
    """
    position, peer = rows.position(source), rows.position("peer")
    known = np.isfinite(position).all(axis=1) & np.isfinite(peer).all(axis=1)
    if np.count_nonzero(known) < 2:
        return {"peer_samples": int(np.count_nonzero(known)), "peer_position_scatter_mm": None}
    rotation = matrix_from_quaternion(rows.quaternion(source)[known])
    back = np.swapaxes(rotation, -1, -2)
    turn = back @ matrix_from_quaternion(rows.quaternion("peer")[known])
    shift = np.einsum("nij,nj->ni", back, (peer - position)[known])
    distance = np.linalg.norm(shift - np.median(shift, axis=0), axis=1)
    angle = np.degrees(angle_between(turn, mean_rotation(turn)))
    return {
        "peer_samples": len(distance),
        "peer_position_scatter_mm": float(np.median(distance) * 1e3),
        "peer_attitude_scatter_deg": float(np.median(angle)),
    }
