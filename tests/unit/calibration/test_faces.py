"""Six faces: the fit against a chip that is known, and every wrong use caught."""

import numpy as np
import pytest

from imu_tracker.calibration.faces import FACES, FaceGuide, FacesFit, Kind, fit_faces
from imu_tracker.calibration.readings import windows
from imu_tracker.errors import CalibrationError
from imu_tracker.recording.capture import capture
from support.turned_box import (
    G_MPS2,
    SIX,
    X_UP,
    Y_UP,
    Z_DOWN,
    Z_UP,
    Box,
    Vec3,
    leaning,
)


def guided(box: Box) -> tuple[FaceGuide, list[Kind]]:
    """Show a guide all that was done to a box; return it and what it said."""
    guide = FaceGuide()
    notes = [guide.feed(window) for window in windows(capture(box.stream).readings)]
    return guide, [note.kind for note in notes if note is not None]


def fitted(box: Box) -> FacesFit:
    guide, _ = guided(box)
    return fit_faces(guide.measured, G_MPS2)


@pytest.mark.parametrize("seed", range(4))
def test_a_poor_chip_is_known_to_a_twentieth_of_a_percent_and_a_mg(seed: int) -> None:
    rng = np.random.default_rng(seed)
    gain = np.eye(3) + 0.02 * rng.choice([-1.0, 1.0], (3, 3))
    gain[np.diag_indices(3)] = 1.0 + 0.03 * rng.choice([-1.0, 1.0], 3)
    signs = rng.choice([-1.0, 1.0], 3)
    bias_g = (0.05 * signs[0], 0.05 * signs[1], 0.05 * signs[2])
    fit = fitted(Box(gain, bias_g, seed=seed).be_laid_on(*SIX))
    assert np.abs(fit.gain - gain).max() < 0.0005
    assert np.abs(fit.bias_mps2 / G_MPS2 - bias_g).max() < 0.001


def test_the_order_of_the_faces_does_not_matter() -> None:
    one = fitted(Box(bias_g=(0.01, 0.02, 0.03)).be_laid_on(*SIX))
    other = fitted(Box(bias_g=(0.01, 0.02, 0.03)).be_laid_on(*reversed(SIX)))
    assert one.bias_mps2 == pytest.approx(other.bias_mps2, abs=0.003)


def test_the_covariance_covers_the_error() -> None:
    truth = (0.01, -0.02, 0.03)
    misses = []
    for seed in range(10):
        fit = fitted(Box(bias_g=truth, seed=seed).be_laid_on(*SIX))
        sigma = np.sqrt(fit.covariance[0, 0])
        misses.append((fit.bias_mps2 - np.array(truth) * G_MPS2) / sigma)
    assert 0.6 < np.std(misses) < 1.7  # six degrees of freedom each: wide tails


def test_each_face_is_recognised_by_itself_and_said() -> None:
    guide, said = guided(Box().be_laid_on(*SIX))
    assert said == [Kind.MEASURED] * 6
    assert not guide.missing
    assert set(guide.measured) == set(FACES)


@pytest.mark.parametrize(
    ("faces", "said"),
    [
        ((Z_UP, X_UP, Z_UP), [Kind.MEASURED, Kind.MEASURED, Kind.AGAIN]),
        # Upside down, back, and upside down again.
        ((Z_UP, Z_DOWN, X_UP, Z_DOWN), [*[Kind.MEASURED] * 3, Kind.AGAIN]),
        ((Z_UP, leaning(X_UP, 25)), [Kind.MEASURED, Kind.ASKEW]),
    ],
)
def test_a_wrong_face_is_refused(faces: tuple[Vec3, ...], said: list[Kind]) -> None:
    guide, kinds = guided(Box().be_laid_on(*faces))
    assert kinds == said
    assert guide.missing


def test_a_box_that_is_moved_too_early_is_refused_and_measured_later() -> None:
    box = Box().be_laid_on(Z_UP, seconds=3.0).be_turned(Z_UP, X_UP)
    _, said = guided(box.lie(X_UP, 8.0))
    assert said == [Kind.MOVED, Kind.MEASURED]


def test_a_box_in_a_hand_is_never_measured() -> None:
    guide, said = guided(Box().be_held(Z_UP, 50.0))
    assert not guide.measured
    assert said == [Kind.HELD]  # once, not every second


def test_a_nudge_after_the_measurement_is_no_second_face() -> None:
    box = Box().be_laid_on(Z_UP).be_held(Z_UP, 1.0).lie(Z_UP, 8.0)
    _, said = guided(box)
    assert said == [Kind.MEASURED]


def test_a_chip_that_feels_half_a_g_is_refused() -> None:
    _, said = guided(Box(0.5 * np.eye(3)).lie(Z_UP, 8.0))
    assert said == [Kind.NOT_GRAVITY]


def test_missing_faces_are_named() -> None:
    guide, _ = guided(Box().be_laid_on(Z_UP, X_UP))
    with pytest.raises(CalibrationError, match=r"-z up, -x up, \+y up, -y up"):
        fit_faces(guide.measured)


def test_a_face_that_leans_does_not_fit_to_the_others() -> None:
    box = Box().be_laid_on(*(leaning(f, 6.0) if f == Y_UP else f for f in SIX))
    guide, _ = guided(box)
    with pytest.raises(CalibrationError, match=r"does not fit .* level table"):
        fit_faces(guide.measured)


def test_a_table_that_leans_a_little_shows_in_residuals_and_covariance() -> None:
    level = fitted(Box().be_laid_on(*SIX))
    one_leans = [leaning(f, 1.0) if f == Y_UP else f for f in SIX]
    leant = fitted(Box().be_laid_on(*one_leans))
    assert np.abs(leant.residuals_mps2).max() > 10 * np.abs(level.residuals_mps2).max()
    assert leant.covariance[0, 0] > 100 * level.covariance[0, 0]
