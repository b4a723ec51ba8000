"""The pass back: against all measurements at once, and on simulated drives."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest

from imu_tracker.config import load_config
from imu_tracker.estimation.error_state.filter import Eskf, Measurement
from imu_tracker.estimation.error_state.hypotheses.receiver_alone import KeptFix
from imu_tracker.estimation.error_state.smoothing import backward, smoother
from imu_tracker.estimation.error_state.smoothing.backward import points
from imu_tracker.estimation.error_state.smoothing.entries import (
    SEEN,
    Change,
    Correction,
    Entry,
    Forgetting,
    Loss,
    Mark,
    nothing_later,
)
from imu_tracker.estimation.error_state.smoothing.receiver import AloneTrack
from imu_tracker.estimation.error_state.states import N_ERRORS, NoiseLevel, Scene
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.geometry.rotation import IDENTITY
from imu_tracker.recording.edit import Outage, hide_gps
from imu_tracker.recording.replay import Replay
from imu_tracker.recording.smoothing import Smoothing
from imu_tracker.samples import NavState, Source
from imu_tracker.simulation import simulate
from imu_tracker.simulation.simulator import START_UTC_S
from support.simulated import Figures, compare, without

SCENE = Scene(LocalFrame.at(0.9, 0.1), 0.0, 0.0, 0.0, True, True, 5.0)
SMALL = NoiseLevel(0.1, 0.1)


def mark(before: Entry | None, t_ns: int, P: np.ndarray) -> Mark:
    nominal = (t_ns, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), IDENTITY)
    return Mark(before, nominal, 0.0, P, SCENE)


def test_the_pass_back_is_the_answer_to_all_measurements_at_once() -> None:
    """The oracle: one Gaussian of all errors of all instants, solved as it stands."""
    rng = np.random.default_rng(11)
    n, steps = N_ERRORS, 6
    P0 = np.diag(rng.uniform(0.5, 2.0, n))
    P0[15, 15] = 0.0  # an error that is known to be zero
    Fs = [np.eye(n) + 0.1 * rng.normal(size=(n, n)) for _ in range(steps)]
    Q = np.diag(rng.uniform(0.0, 0.1, n))
    H, R = rng.normal(size=(2, n)), np.diag([0.3, 0.2])
    truth = rng.multivariate_normal(np.zeros(n), P0)

    # forward, in closed loop: the estimate moves, the errors are those against it
    estimate, P = np.zeros(n), P0
    entry: Entry | None = None
    marks, estimates, zs = [], [], []
    covs, ways = [], []
    state_cov = P0
    for k in range(steps):
        F = Fs[k]
        truth = F @ truth + rng.multivariate_normal(np.zeros(n), Q)
        estimate, P = F @ estimate, F @ P @ F.T + Q
        state_cov = F @ state_cov @ F.T + Q
        entry = Change(entry, F)
        z = H @ truth + rng.multivariate_normal(np.zeros(2), R)
        zs.append(z)
        entry = Correction(entry, P, z - H @ estimate, H, R)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        estimate, P = estimate + K @ (z - H @ estimate), P - K @ H @ P
        entry = mark(entry, k, P)
        marks.append(entry)
        estimates.append(estimate)
        covs.append(state_cov)
        ways.append(F)

    def cross(i: int, j: int) -> np.ndarray:
        """Covariance of the errors of two instants before anything was measured."""
        if i > j:
            return cross(j, i).T
        cov = covs[i]
        for k in range(i + 1, j + 1):
            cov = cov @ ways[k].T
        return cov

    S = np.block(
        [
            [H @ cross(i, j) @ H.T + (R if i == j else 0.0) for j in range(steps)]
            for i in range(steps)
        ]
    )
    z_all = np.concatenate(zs)
    later, at = nothing_later(), entry
    seen = 0
    while at is not None:
        if isinstance(at, Mark):
            k = marks.index(at)
            G = np.hstack([cross(k, j) @ H.T for j in range(steps)])
            mean = G @ np.linalg.solve(S, z_all)
            cov = covs[k] - G @ np.linalg.solve(S, G.T)
            errors, told = at.errors(later)
            rows = list(SEEN)
            assert errors + estimates[k][rows] == pytest.approx(mean[rows], abs=1e-8)
            assert told == pytest.approx(cov[np.ix_(rows, rows)], abs=1e-8)
            seen += 1
        else:
            later = at.back(later)
        at = at.before
    assert seen == steps


def test_what_was_begun_anew_learns_nothing_from_what_came_later() -> None:
    P = np.eye(N_ERRORS)
    before = mark(None, 0, P)
    H = np.zeros((2, N_ERRORS))
    H[0, 0] = H[1, 1] = 1.0
    entry = Correction(
        Forgetting(before, slice(0, 3)), P, np.array([5.0, 0.0]), H, np.eye(2)
    )
    errors, cov = before.errors(Forgetting(None, slice(0, 3)).back(nothing_later()))
    later = entry.before.back(entry.back(nothing_later())) if entry.before else None
    assert later is not None
    errors, cov = before.errors(later)
    assert not errors.any()
    assert cov == pytest.approx(np.eye(len(SEEN)))


def test_a_filter_that_was_lost_is_corrected_and_doubted_back_to_its_last_fix() -> None:
    P = np.eye(N_ERRORS)
    H = np.zeros((2, N_ERRORS))
    H[0, 0] = H[1, 1] = 1.0
    tracking = mark(None, 0, P)
    dark = mark(tracking, 1, P)
    dark.scene = SCENE._replace(outage_s=20.0)
    newest = Loss(dark, P, np.array([30.0, 0.0]), H, 0.01 * np.eye(2))
    first, second = points(newest, (0.0, 0.0, 0.0))
    north, _ = SCENE.frame.to_ne(second.lat_rad, second.lon_rad)
    assert north == pytest.approx(29.7, abs=0.1)
    assert second.r95_m > 10.0 * first.r95_m


def test_a_filter_keeps_nothing_unless_it_is_asked_to() -> None:
    eskf = Eskf(SMALL, is_vehicle=True)
    H = np.zeros((1, N_ERRORS))
    H[0, 0] = 1.0
    measured = Measurement(np.array([1.0]), H, np.eye(1))
    eskf.update(measured)
    assert eskf.past is None
    eskf.keeps_history = True
    eskf.update(measured)
    copied = eskf.clone(SMALL)
    copied.update(measured)
    assert copied.past is not None
    assert copied.past.before is eskf.past, "a copy shares what was before"


# ------------------------------------------------------------------ simulated drives

LENGTH_S = 300.0
HIDDEN = (Outage(120.0, 60.0), Outage(220.0, 30.0))


@cache
def tracked(kind: type[Replay], seed: int = 8) -> tuple[list[NavState], Figures]:
    made = simulate("drive", seed=seed, duration_s=LENGTH_S)
    stream = hide_gps([made.header, *made.frames], list(HIDDEN))
    rows = list(kind(load_config(None, ["filter.profile=vehicle"])).rows(stream))
    return rows, compare(rows, list(made.truth))


def test_the_rows_are_those_of_a_replay_but_for_where_they_are() -> None:
    (replayed, _), (smoothed, _) = tracked(Replay), tracked(Smoothing)
    assert [(row.utc_s, row.mode) for row in smoothed] == [
        (row.utc_s, row.mode) for row in replayed
    ]


def test_a_tunnel_is_known_from_both_ends() -> None:
    for hidden in HIDDEN:
        end_s = hidden.start_s + hidden.length_s
        forward = tracked(Replay)[1].between(hidden.start_s, end_s)
        smoothed = tracked(Smoothing)[1].between(hidden.start_s, end_s)
        assert smoothed.error_m.max() < 0.5 * forward.error_m.max()
        assert smoothed.r95_m.max() < 0.6 * forward.r95_m.max()
        assert smoothed.inside > 0.9


def test_with_gps_it_is_not_worse_and_as_true() -> None:
    forward, smoothed = (
        tracked(kind)[1].between(30.0, 120.0) for kind in (Replay, Smoothing)
    )
    assert smoothed.rms < 1.02 * forward.rms
    assert smoothed.inside > 0.9
    assert np.median(smoothed.r95_m) < np.median(forward.r95_m)


def test_to_smooth_changes_nothing_of_the_filters() -> None:
    """The last row has nothing after it: it is the replay's."""
    (replayed, _), (smoothed, _) = tracked(Replay), tracked(Smoothing)
    off = LocalFrame.at(replayed[-1].lat_rad, replayed[-1].lon_rad).to_ne(
        smoothed[-1].lat_rad, smoothed[-1].lon_rad
    )
    assert np.hypot(*off) < 0.3


def test_pieces_join_without_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, _ = tracked(Smoothing)
    monkeypatch.setattr(smoother, "PIECE_S", 100.0)
    monkeypatch.setattr(smoother, "OVERLAP_S", 50.0)
    made = simulate("drive", seed=8, duration_s=LENGTH_S)
    stream = hide_gps([made.header, *made.frames], list(HIDDEN))
    smoothing = Smoothing(load_config(None, ["filter.profile=vehicle"]))
    pieces = list(smoothing.rows(stream))
    assert len(pieces) == len(whole)
    for one, other in zip(whole, pieces, strict=True):
        off = LocalFrame.at(one.lat_rad, one.lon_rad).to_ne(
            other.lat_rad, other.lon_rad
        )
        assert np.hypot(*off) < 0.15 * one.r95_m


def test_what_is_kept_does_not_grow_with_the_drive(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lengths = []

    def count(newest: Entry | None, lever: tuple[float, ...]) -> list[backward.Point]:
        entry, length = newest, 0
        while entry is not None:
            entry, length = entry.before, length + 1
        lengths.append(length)
        return points(newest, (0.0, 0.0, 0.0))

    monkeypatch.setattr(smoother, "PIECE_S", 60.0)
    monkeypatch.setattr(smoother, "OVERLAP_S", 30.0)
    monkeypatch.setattr(smoother, "points", count)
    made = simulate("drive", seed=8, duration_s=LENGTH_S)
    smoothing = Smoothing(load_config(None, ["filter.profile=vehicle"]))
    assert list(smoothing.rows([made.header, *made.frames]))
    assert len(lengths) > 5
    assert max(lengths[2:]) < 1.5 * lengths[0]


@pytest.mark.parametrize("silence_s", [(80.0, 160.0), (0.0, LENGTH_S)])
def test_where_the_imu_was_silent_the_receiver_alone_is_smoothed(
    silence_s: tuple[float, float],
) -> None:
    made = simulate("drive", seed=8, duration_s=LENGTH_S)
    frames = without(made.frames, Source.IMU, *silence_s)
    rows = list(Smoothing(load_config(None)).rows([made.header, *frames]))
    figures = compare(rows, list(made.truth))
    since_s = figures.utc_s - START_UTC_S
    begin_s, end_s = max(silence_s[0] + 10.0, 30.0), silence_s[1] - 5.0
    is_silent = (since_s > begin_s) & (since_s < end_s)
    assert np.mean((figures.error_m <= figures.r95_m)[is_silent]) > 0.9
    assert figures.error_m[is_silent].max() < 10.0


def fixes(places: Sequence[tuple[float, float]]) -> list[KeptFix]:
    """Fixes along a meridian, at seconds and metres."""
    frame, found = LocalFrame.at(0.9, 0.1), []
    for t_s, north_m in places:
        lat, lon = frame.to_lat_lon(north_m, 0.0)
        found.append(KeptFix(round(t_s * 1e9), lat, lon, None, 1.0, 1.0, 0.0, 1.0))
    return found


def test_the_receiver_alone_is_as_good_as_all_fixes_at_once() -> None:
    """White noise about a straight line: least squares is the oracle, amid the line."""
    rng = np.random.default_rng(3)
    t_s = np.arange(41.0)
    z = 10.0 * t_s + rng.normal(size=41)
    track = AloneTrack(
        [
            fix._replace(accel_psd=1e-9)
            for fix in fixes(list(zip(t_s.tolist(), z.tolist(), strict=True)))
        ]
    )
    line = np.polynomial.Polynomial.fit(t_s, z, 1)
    for at_s in (5.0, 20.5, 35.0):
        place = track.at(round(at_s * 1e9))
        assert place is not None
        north, _ = LocalFrame.at(0.9, 0.1).to_ne(place.lat_rad, place.lon_rad)
        assert north == pytest.approx(line(at_s), abs=0.05)


def test_between_two_fixes_the_receiver_alone_is_less_sure() -> None:
    track = AloneTrack(fixes([(t, 10.0 * t) for t in (*range(10), *range(40, 50))]))
    amid, at_end = track.at(25_000_000_000), track.at(9_000_000_000)
    assert amid is not None
    assert at_end is not None
    north, _ = LocalFrame.at(0.9, 0.1).to_ne(amid.lat_rad, amid.lon_rad)
    assert north == pytest.approx(250.0, abs=5.0)
    assert amid.r95_m > 2.0 * at_end.r95_m


def test_before_the_first_fix_it_is_as_unsure_as_after_the_last() -> None:
    # The model is the same in both directions; only the filter's start breaks that.
    track = AloneTrack(fixes([(t, 10.0 * t) for t in range(20)]))
    before, after = track.at(-2_000_000_000), track.at(21_000_000_000)
    assert before is not None
    assert after is not None
    assert before.r95_m == pytest.approx(after.r95_m, rel=0.01)


def test_one_wild_fix_is_left_out() -> None:
    track = AloneTrack(fixes([(t, 500.0 if t == 20 else 10.0 * t) for t in range(40)]))
    place = track.at(20_000_000_000)
    assert place is not None
    north, _ = LocalFrame.at(0.9, 0.1).to_ne(place.lat_rad, place.lon_rad)
    assert north == pytest.approx(200.0, abs=1.0)


def test_without_a_fix_there_is_no_place() -> None:
    assert AloneTrack([]).at(0) is None
