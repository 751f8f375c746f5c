"""The lighthouse's pose sensor: from one period's sweep angles to a pose per craft with its covariance.

angles, less the known errors of the fans            estimators.lighthouse.sweep
-> pose at the epoch, LM on (7) from the prediction   estimators.lighthouse.pnp   (searching: acquisition)
-> residuals tested, false photodiodes dropped        estimators.lighthouse.integrity, by swarm.onboard.integrity
-> H, ADOP, PDOP at that pose (13) to (22)            estimators.lighthouse.dop
-> measurement covariance s^2 H (18)
   or, of a plane that is nearly face-on, what its angles say to second order   estimators.lighthouse.planar
"""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints
from estimators.filter.error_state import POSE, POSE_COLUMNS
from estimators.kernel import kernel
from estimators.lighthouse.dop import Dilution, dilution, overwrite, unknown
from estimators.lighthouse.integrity import AngleNoise, Sweeps, linearised
from estimators.lighthouse.planar import Rows, Side, Spread, bends, is_flat, pose_rows, spread
from estimators.lighthouse.pnp import PoseSolution, refine_with_dilution
from estimators.lighthouse.separation import Linear
from estimators.lighthouse.sweep import HALF_PI, FanErrors, correct, lighthouse_1, measured_angles
from estimators.state import State
from swarm.onboard.acquisition import DECISIVE, NONE, Hypotheses, Sighting, advance, search
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.integrity import Integrity, Monitor, Screened, Separated
from swarm.onboard.settings import MIN_LIT, NavigationSettings, Sensor
from swarm.onboard.tracks import UNKNOWN_RATE, Filtered, Pair, PoseFix, Taken, Tracks

LIGHTHOUSE = int(Sensor.LIGHTHOUSE)
"""The code as a plain number, which NumPy takes at once."""
SIDE_PERIODS = 6
"""Periods after which the evidence on the sign of a tilt is forgotten: a craft may have turned meanwhile."""
PAIR_APART = 36.0
"""Squared distance of two poses, in the covariance of both, beyond which a filter is started at each."""
LARGEST_BLIND_S = 0.25
"""Time without a pose or single sweeps [s] beyond which a track predicts no angle."""


class Light(NamedTuple):
    """Results of C craft from the lighthouse's light in one period.

    visible: number of photodiodes seen by both fans, (C,). theta: measured sweep angles, less the rotor's speed, NaN
    where not seen, (C, K, 2) [rad]. screened: poses after the residual test. dilution: dilution of precision at those
    poses, or at the predictions of craft that take single sweeps. linear: the poses to first order, where levels by
    separation need them.
    """

    visible: Ints
    theta: Floats
    screened: Screened
    dilution: Dilution
    linear: Linear | None = None


class _Start(NamedTuple):
    """Start poses of this period's LM.

    found: craft whose search has just ended with a pose, (C,). rotation: (C, 3, 3). position: (C, 3) [m]. spread: what
    the angles allow, of craft found whose pose the first-order covariance does not tell.
    """

    found: Bools
    rotation: Floats
    position: Floats
    spread: dict[int, Spread]


class LighthouseFix:
    """The lighthouse's pose sensor on board of C craft; searching craft keep their hypotheses between periods.

    undecided: craft whose measurements fit more than one pose, (C,). pairs: those that this period leaves with two,
    by index.
    """

    def __init__(self, point_m: Floats, settings: NavigationSettings) -> None:
        """Take the photodiodes, point_m (C, K, 3) [m], at the positions that the craft assume."""
        craft, most, _ = point_m.shape
        self.settings, self._point_m = settings, point_m
        self._hypotheses: list[Hypotheses] = [NONE] * craft
        self.undecided = np.zeros(craft, dtype=np.bool_)
        self.pairs: dict[int, Pair] = {}
        # What craft share is counted in of filters that have started.
        self._pairs_wanted = settings.coupling != "loose" and not settings.relations.any
        self._fans = lighthouse_1(settings.fan_x, settings.fan_y)
        self._perfect = all(errors == FanErrors() for errors in (settings.fan_x, settings.fan_y))
        self._side: list[tuple[int, Side] | None] = [None] * craft
        self._flat = [(b"", False)] * craft
        self._period, self._sensor = 0, np.full(craft, LIGHTHOUSE)
        self._noise = settings.noise
        self._size_m = np.linalg.norm(np.nan_to_num(point_m), axis=2).max(axis=1, initial=0.0)
        self._sigma_rad, self._rho = settings.angle_noise_rad, settings.rotor_correlation
        self._monitor = Monitor(settings.integrity, self._noise, settings.angle_noise_rad, (craft, most))

    @property
    def own_rad(self) -> float:
        """Noise of one photodiode's angle, beside what all of a sweep share [rad]."""
        return self._noise.own_rad

    def assume(self, noise: AngleNoise) -> None:
        """Take angles to have this noise from now on."""
        self._noise, self._sigma_rad = noise, float(np.hypot(*noise))
        self._rho = (noise.shared_rad / self._sigma_rad) ** 2
        self._monitor.assume(noise)

    def forget(self, mask: Bools) -> None:
        """Forget the results of the craft of the mask (C,)."""
        for craft in np.flatnonzero(mask):
            self._hypotheses[craft], self._side[craft] = NONE, None
        self.undecided[mask] = False
        self._monitor.forget(mask)

    def expected(self, tracks: Tracks, turn_s: float, craft: Ints | None = None) -> Floats:
        """Return the angles at which the next period's sweeps should meet each photodiode, (N, K, 2) [rad].

        Fans X and Y sweep a quarter of a turn before and after the epoch. NaN for craft without a recent pose.

        Args:
            tracks: filters, at the last epoch.
            turn_s: one turn of the rotor [s].
            craft: (N,), the craft that are asked for; None: all.
        """
        craft = np.arange(len(self._point_m)) if craft is None else craft
        s, out = self.settings, np.full((len(craft), self._point_m.shape[1], 2), np.nan)
        known = np.flatnonzero((tracks.bank.active & (tracks.since_update_s <= LARGEST_BLIND_S))[craft])
        if not len(known):
            return out
        who = craft[known]
        now = s.station.state_into(tracks.bank.state)
        now = State._make(part[who] for part in now)
        for fan, quarter in enumerate((-0.25, 0.25)):
            then = now.ahead(s.frame_s + quarter * turn_s)
            points = self._point_m[who] @ np.swapaxes(then.rotation, -1, -2) + then.position[:, None]
            out[known, :, fan] = HALF_PI + measured_angles(points, self._fans[fan : fan + 1])[..., 0]
        return out

    def find(self, angles: SweepAngles, tracks: Tracks, imaged: Bools) -> tuple[Light, PoseFix]:
        """Return the poses that all craft derive from their angles, starting from the filters' predictions.

        Args:
            angles: sweep angles of all craft.
            tracks: their filters.
            imaged: craft (C,) whose mirror image is followed: a pose would be of one of both.
        """
        s, active = self.settings, tracks.bank.active
        predicted = s.station.state_into(tracks.bank.state)
        lost = tracks.lost(s.search_again_s)
        # In tight mode the sweeps themselves go into a filter that runs; a pose only starts one, or finds it again.
        solved = (lost if s.coupling == "tight" else active) & ~imaged
        turned, theta, lit, used, visible = self._ideal(angles, solved)
        enough = visible >= MIN_LIT
        start = self._acquire(theta, lit, angles.offset_s, enough, lost, predicted, tracks)
        known = enough & solved
        if (found := start.found & ~imaged).any():
            known |= found
            used[found] = lit[found]
        # The motion within the period as each craft estimates it; a craft with its first pose has no estimate of it.
        # The predictions are copies.
        rates, still = (predicted.angular_rate, predicted.velocity), np.flatnonzero(~active)
        for rate in rates:
            rate[still if s.motion_compensation else slice(None)] = 0.0
        sweeps = Sweeps(
            theta=theta,
            lit=used,
            point_m=self._point_m,
            offset_s=angles.offset_s,
            angular_rate=rates[0],
            velocity=rates[1],
        )
        screened, precision = self._solve(sweeps, known, visible, start, tracks)
        # Where the sweeps themselves go into the filter, precision is that at the prediction.
        self._make_precise(precision, screened, sweeps, lit, enough & active & ~known, predicted)
        linear: Linear | None = None
        if s.integrity.false_photodiodes:
            seen, solution = sweeps._replace(lit=screened.lit), screened.solution
            linear = Linear(*linearised(seen, solution.rotation, solution.position)[:2], screened.lit)
        rotation, position = s.station.pose_out(screened.solution.rotation, screened.solution.position)
        rows = self._rows(sweeps, screened, precision, predicted, tracks)
        screened = screened._replace(solution=screened.solution._replace(rotation=rotation, position=position))
        fix = self._spread_out(self._fix(screened, precision), start.spread)._replace(rows=rows)
        return Light(visible, turned, screened, precision, linear), fix

    def _make_precise(
        self, precision: Dilution, screened: Screened, sweeps: Sweeps, lit: Bools, unsolved: Bools, predicted: State
    ) -> None:
        """Complete the precision of this period's poses, which was made as they were solved.

        Args:
            precision: of the poses; changed in place, NaN where there is none.
            screened: the poses; some were solved again, with fewer photodiodes.
            sweeps: what they were solved from.
            lit: (C, K), all light.
            unsolved: (C,), craft whose precision is that of all their light at the prediction.
            predicted: the filters' predictions.
        """
        again = screened.solution.solved & (screened.dropped != 0) | unsolved
        other: Dilution | None = None
        if again.any():
            at = screened.solution.rotation, screened.solution.position
            used = screened.lit
            if unsolved.any():
                at = (
                    np.where(unsolved[:, None, None], predicted.rotation, at[0]),
                    np.where(unsolved[:, None], predicted.position, at[1]),
                )
                used = np.where(unsolved[:, None], lit, used)
            other = dilution(
                *at,
                used,
                sweeps.point_m,
                sweeps.offset_s,
                sweeps.angular_rate,
                sweeps.velocity,
                self._rho,
                again,
            )
        # Of a pose that was given up after it had been solved, too, there is none.
        given_up = np.isfinite(precision.pdop_m_per_rad) & ~screened.solution.solved
        overwrite(precision, again | given_up, other)

    def levels(
        self, light: Light, taken: Taken, after: Filtered, sweep_fault: Floats, separated: Separated | None = None
    ) -> Integrity:
        """Return the protection levels of this period's poses, and of the filters after all fixes.

        Args:
            light: this period's results from the lighthouse.
            taken: result of the update of every filter with its pose.
            after: filters after all fixes.
            sweep_fault: (2, C), of single sweeps, as in `Monitor.levels`.
            separated: levels of the filters by separation of solutions, where they are known so.
        """
        return self._monitor.levels(light.screened, light.dilution, taken, after, sweep_fault, separated)

    def _ideal(self, angles: SweepAngles, solved: Bools) -> tuple[Floats, Floats, Bools, Bools, Ints]:
        """Return the angles (C, K, 2) less rotor speed, and less fan errors too, the mask (C, K) of the latter, that of
        those that the craft of a mask (C,) solve a pose from, and each craft's number of them, (C,).
        """
        s = self.settings
        speed = self._monitor.speed(angles, s.frame_s)
        turned = angles.theta if speed is None else angles.theta * speed[:, None, None]
        straight = turned if self._perfect else correct(turned, (s.fan_x, s.fan_y))
        theta, lit, used = np.empty_like(straight), np.empty_like(angles.lit), np.empty_like(angles.lit)
        visible = np.empty(len(straight), np.int64)
        _seen_into(straight, angles.lit, solved, theta, lit, used, visible)
        return turned, theta, lit, used, visible

    def _solve(
        self, sweeps: Sweeps, known: Bools, visible: Ints, start: _Start, tracks: Tracks
    ) -> tuple[Screened, Dilution]:
        """Solve every craft's pose from its start, and test the residuals; return the precision of the poses, too."""
        if not known.any():
            none = _unsolved(len(known)), sweeps.lit, visible, np.zeros(len(known), dtype=np.int64)
            return Screened(*none), unknown(len(known))
        pnp, precision = refine_with_dilution(
            sweeps.theta,
            sweeps.lit,
            sweeps.point_m,
            start.rotation,
            start.position,
            sweeps.offset_s,
            sweeps.angular_rate,
            sweeps.velocity,
            self._rho,
        )
        pnp = pnp._replace(solved=pnp.solved & (pnp.residual_rad < self.settings.residual_limit_rad))
        begun = start.rotation, start.position
        return self._monitor.screen(sweeps, known, visible, pnp, begun, tracks.rate_covariance), precision

    def _fix(self, screened: Screened, precision: Dilution) -> PoseFix:
        """Return the poses with the covariance s^2 H of (18)."""
        s, pnp = self.settings, screened.solution
        coupling = s.station.matrix_out(precision.rate_coupling)
        return PoseFix(
            known=pnp.solved & np.isfinite(precision.pdop_m_per_rad),
            rotation=pnp.rotation,
            position=pnp.position,
            covariance=s.station.matrix_out(self._sigma_rad**2 * precision.covariance),
            coupling=coupling if s.motion_compensation else np.zeros_like(coupling),
            start_coupling=coupling,
            sensor=self._sensor,
            tested=s.integrity.residual_test,
        )

    def _rows(
        self, sweeps: Sweeps, screened: Screened, precision: Dilution, predicted: State, tracks: Tracks
    ) -> Rows | None:
        """Return the rows of tracked craft whose light is of one plane nearly face-on; None if there are none."""
        s, bank, pnp = self.settings, tracks.bank, screened.solution
        mask = bank.active & pnp.solved
        if not _keep_bent(mask, precision.adop_deg_per_rad, self._sigma_rad, self._size_m, pnp.position, self._noise):
            return None
        for i in np.flatnonzero(mask).tolist():
            mask[i] = self._is_flat(i, screened.lit[i])
        if not mask.any():
            return None
        who, covariance = np.flatnonzero(mask), np.empty((len(mask), POSE, POSE))
        own = bank.covariance_where(mask)[who][:, POSE_COLUMNS[:, None], POSE_COLUMNS]
        covariance[who] = s.station.matrix_into(own)
        seen = sweeps._replace(lit=screened.lit)
        rows = pose_rows(seen, mask, predicted.rotation, predicted.position, covariance, self._noise)
        rates = s.station.rows_out(rows.rates) if s.motion_compensation else np.zeros_like(rows.rates)
        return rows._replace(pose=s.station.rows_out(rows.pose), rates=rates)

    def _is_flat(self, craft: int, lit: Bools) -> bool:
        """Return `is_flat` of a craft's lit photodiodes (K,); mostly they are those of its period before."""
        key = lit.tobytes()
        if self._flat[craft][0] != key:
            self._flat[craft] = key, is_flat(self._point_m[craft][lit])
        return self._flat[craft][1]

    def _spread_out(self, fix: PoseFix, spreads: dict[int, Spread]) -> PoseFix:
        """Return the fix with the mean and covariance of all possible poses where the solved one is one of many."""
        if not spreads:
            return fix
        station, at = self.settings.station, list(spreads)
        pose = (np.stack([getattr(spreads[i], name) for i in at]) for name in ("rotation", "position"))
        matrices = (np.stack([getattr(spreads[i], name) for i in at]) for name in ("covariance", "coupling"))
        found = (*station.pose_out(*pose), *(station.matrix_out(matrix) for matrix in matrices))
        # Copies: the solved poses themselves are telemetry.
        parts = fix.rotation.copy(), fix.position.copy(), fix.covariance.copy(), fix.start_coupling.copy()
        for part, own in zip(parts, found, strict=True):
            part[at] = own
        return fix._replace(rotation=parts[0], position=parts[1], covariance=parts[2], start_coupling=parts[3])

    def _acquire(
        self,
        theta: Floats,
        lit: Bools,
        offset_s: Floats,
        enough: Bools,
        lost: Bools,
        predicted: State,
        tracks: Tracks,
    ) -> _Start:
        """Return start poses for LM: the prediction, or the result of a search for a craft without one.

        Args:
            theta: (C, K, 2) [rad], sweep angles less all known errors.
            lit: (C, K).
            offset_s: (C, K, 2) [s].
            enough: (C,), craft with light enough for a pose.
            lost: (C,), craft that search although they have a filter.
            predicted: the filters' predictions, in the station's frame.
            tracks: the filters.
        """
        active = tracks.bank.active
        self._period += 1
        self.pairs = {}
        start = _Start(np.zeros(len(enough), dtype=np.bool_), predicted.rotation, predicted.position, {})
        searching = enough & (lost | ~active)
        if not searching.any():
            return start
        who = np.flatnonzero(searching)
        before = [self._hypotheses[i] for i in who]
        sightings = [Sighting(theta[i], lit[i], self._point_m[i], offset_s[i]) for i in who]
        after = advance(before, sightings, self._noise.own_rad)
        for i, hypotheses, sighting in zip(who.tolist(), after, sightings, strict=True):
            if not active[i] and len(hypotheses.evidence) and not hypotheses.decided:
                hypotheses = self._without_false(hypotheses, sighting, tracks.rate_covariance(i))
            chosen: int | None = None
            possible = None
            if hypotheses.decided and not active[i]:
                possible = self._possible(i, hypotheses, sighting)
            if possible is not None and not possible.contained:
                # Alone and yet one of many: it is not followed, for it stays alone where its mirror image appears.
                self._hypotheses[i] = NONE if len(hypotheses.evidence) == 1 else hypotheses
                self.undecided[i] = True
                continue
            if possible is not None:
                start.spread[i] = possible
            if hypotheses.decided:
                chosen, start.found[i] = 0, not active[i]
            elif active[i] and len(hypotheses.evidence):
                # After a long coast the prediction itself distinguishes mirror poses; the gate decides at last.
                chosen = int(np.argmin(rot.angle_between(hypotheses.rotation, start.rotation[i])))
            if chosen is not None:
                start.rotation[i], start.position[i] = hypotheses.rotation[chosen], hypotheses.position[chosen]
                hypotheses = NONE
            self._hypotheses[i] = hypotheses
            self.undecided[i] = len(hypotheses.evidence) > 0
            if not active[i] and (pair := self._pair(i, hypotheses, sighting)) is not None:
                self.pairs[i], self._hypotheses[i], self.undecided[i] = pair, NONE, False
        return start

    def _pair(self, craft: int, hypotheses: Hypotheses, seen: Sighting) -> Pair | None:
        """Return the two poses that are left to a searching craft; None if more or fewer are, or if they are so near
        each other that a covariance does not tell each.
        """
        s, evidence = self.settings, hypotheses.evidence
        if not self._pairs_wanted or len(evidence) < 2 or np.count_nonzero(evidence - evidence[0] < DECISIVE) != 2:
            return None
        rotation, position = hypotheses.rotation[:2], hypotheses.position[:2]
        two = _at_rest(seen).of(np.zeros(2, dtype=np.int64))
        both = np.ones(2, dtype=np.bool_)
        precision = dilution(
            rotation, position, two.lit, two.point_m, two.offset_s, two.angular_rate, two.velocity, self._rho, both
        )
        away = np.concatenate([rot.log(rotation[1] @ rotation[0].T), position[1] - position[0]])
        both_covariances = self._sigma_rad**2 * precision.covariance.sum(axis=0)
        if not np.isfinite(both_covariances).all() or away @ np.linalg.solve(both_covariances, away) < PAIR_APART:
            return None
        return Pair(
            *s.station.pose_out(rotation, position),
            s.station.matrix_out(self._sigma_rad**2 * precision.covariance),
            s.station.matrix_out(precision.rate_coupling),
            float(evidence[1] - evidence[0]),
        )

    def _possible(self, craft: int, hypotheses: Hypotheses, seen: Sighting) -> Spread | None:
        """Return the poses that a searching craft's angles allow; None if first order tells them."""
        if not is_flat(seen.point_m[seen.lit]):
            return None
        one = _at_rest(seen)
        best = hypotheses.rotation[0], hypotheses.position[0]
        last = self._side[craft]
        before = last[1] if last is not None and self._period - last[0] <= SIDE_PERIODS else None
        out = spread(one, *best, self._noise, UNKNOWN_RATE, hypotheses.rotation[1:], DECISIVE, before)
        if out is not None and not out.contained:
            # Rates of up to five sigmas leave hardly any tilt out: then they count to first order, as otherwise.
            out = spread(one, *best, self._noise, (0.0, 0.0), hypotheses.rotation[1:], DECISIVE, before)
        self._side[craft] = None if out is None else (self._period, out.side)
        return out

    def _without_false(self, hypotheses: Hypotheses, seen: Sighting, rate_covariance: Floats) -> Hypotheses:
        """Return the hypotheses of a searching craft, without a false photodiode if one spoils them."""
        one = _at_rest(seen)
        lit = self._monitor.honest(one, hypotheses.rotation[0], hypotheses.position[0], rate_covariance)
        return hypotheses if lit is None else search(seen._replace(lit=lit), self._noise.own_rad)


def _unsolved(craft: int) -> PoseSolution:
    """Return no pose of any of C craft, as `refine` does."""
    return PoseSolution(
        rotation=np.full((craft, 3, 3), np.nan),
        position=np.full((craft, 3), np.nan),
        solved=np.zeros(craft, dtype=np.bool_),
        iterations=np.zeros(craft, dtype=np.int64),
        residual_rad=np.full(craft, np.nan),
        cost=np.full(craft, np.nan),
    )


def _at_rest(seen: Sighting) -> Sweeps:
    """Return the angles of one searching craft as a batch of one, as if at rest."""
    rest = np.zeros((1, 3))
    return Sweeps(seen.theta[None], seen.lit[None], seen.point_m[None], seen.offset_s[None], rest, rest)


@kernel
def _keep_bent(mask: Bools, adop: Floats, sigma_rad: float, size: Floats, position: Floats, noise: AngleNoise) -> bool:
    """Keep the craft of the mask (C,) of which the first order says too little; return whether there are any.

    Args:
        mask: (C,), craft with a pose.
        adop: (C,) [deg/rad].
        sigma_rad: noise of an angle, all of it [rad].
        size: (C,) [m], largest distance of a photodiode from its body's origin.
        position: (C, 3) [m], lighthouse frame.
        noise: of the angles, by its parts.
    """
    some = False
    for c in range(len(mask)):
        if mask[c]:
            x, y, z = position[c, 0], position[c, 1], position[c, 2]
            mask[c] = bends(np.deg2rad(adop[c]) * sigma_rad, size[c], np.sqrt(x * x + y * y + z * z), noise)
            some |= mask[c]
    return some


@kernel
def _seen_into(given: Floats, by: Bools, solved: Bools, theta: Floats, lit: Bools, used: Bools, visible: Ints) -> None:
    """Write the angles of C craft without those of directions behind the lighthouse, and which photodiodes have two.

    Args:
        given: (C, K, 2) [rad], NaN where there is none.
        by: (C, K), photodiodes that the decoder saw.
        solved: (C,), craft that solve a pose from enough of them.
        theta: (C, K, 2) [rad], receives them; NaN in pairs.
        lit: (C, K), receives the photodiodes with two.
        used: (C, K), receives those that a pose is solved from.
        visible: (C,), receives their numbers.
    """
    for c in range(len(visible)):
        seen = 0
        for k in range(lit.shape[1]):
            x, y = given[c, k, 0], given[c, k, 1]
            front = (abs(x - HALF_PI) < HALF_PI) & (abs(y - HALF_PI) < HALF_PI)
            theta[c, k, 0], theta[c, k, 1] = x if front else np.nan, y if front else np.nan
            lit[c, k] = by[c, k] & front
            seen += lit[c, k]
        visible[c] = seen
        for k in range(lit.shape[1]):
            used[c, k] = lit[c, k] & solved[c] & (seen >= MIN_LIT)
