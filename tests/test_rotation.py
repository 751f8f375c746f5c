"""Rotations against SciPy, their group axioms, and the ends of the series: 1e-7 from identity and from pi."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimators import rotation as rot
from estimators.arrays import Floats

# A product of a few matrices and one trigonometric call: some tens of rounding errors of 1.1e-16.
ROUNDING = 5e-15

ANGLES = [0.0, 1e-12, 1e-7, 0.99e-4, 1.01e-4, 0.99e-2, 1.01e-2, 0.5, 1.5, 3.0, np.pi - 1e-3, np.pi - 1e-7]
BATCHES = [(), (5,), (2, 3), (0,)]


def vectors(count: int, seed: int = 0) -> Floats:
    """Rotation vectors (angles * count, 3) of every length in ANGLES, in random directions."""
    axis = np.random.default_rng(seed).standard_normal((len(ANGLES), count, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    return np.asarray(axis * np.array(ANGLES)[:, None, None]).reshape(-1, 3)


def random(shape: tuple[int, ...], seed: int = 0) -> Floats:
    return rot.exp(np.random.default_rng(seed).uniform(-2, 2, (*shape, 3)))


def test_exp_is_scipy() -> None:
    v = vectors(20)
    np.testing.assert_allclose(rot.exp(v), Rotation.from_rotvec(v).as_matrix(), atol=ROUNDING)


def test_log_is_scipy_and_inverts_exp() -> None:
    v = vectors(20)
    np.testing.assert_allclose(rot.log(rot.exp(v)), v, atol=ROUNDING)
    np.testing.assert_allclose(rot.log(rot.exp(v)), Rotation.from_matrix(rot.exp(v)).as_rotvec(), atol=1e-14)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (0.6, -0.8, 0.0)])
def test_log_of_a_half_turn(axis: tuple[float, float, float]) -> None:
    # Both signs of the vector are the same rotation: compare the matrices.
    half_turn = rot.exp(np.pi * np.array(axis))
    vector = rot.log(half_turn)
    assert np.linalg.norm(vector) == pytest.approx(np.pi, abs=ROUNDING)
    np.testing.assert_allclose(rot.exp(vector), half_turn, atol=ROUNDING)


def test_beyond_pi_wraps() -> None:
    v = np.array([0.0, 0.0, np.pi + 0.5])
    np.testing.assert_allclose(rot.log(rot.exp(v)), [0.0, 0.0, 0.5 - np.pi], atol=ROUNDING)


@pytest.mark.parametrize("batch", BATCHES)
def test_group_axioms(batch: tuple[int, ...]) -> None:
    a, b, c = (random(batch, seed) for seed in range(3))
    transposed = np.swapaxes(a, -1, -2)
    np.testing.assert_allclose(transposed @ a, np.broadcast_to(np.eye(3), a.shape), atol=ROUNDING)
    np.testing.assert_allclose(np.linalg.det(a), np.ones(batch), atol=ROUNDING)
    np.testing.assert_allclose(rot.exp(-rot.log(a)), transposed, atol=ROUNDING)
    qa, qb, qc = (rot.quaternion_from_matrix(m) for m in (a, b, c))
    np.testing.assert_allclose(rot.matrix_from_quaternion(rot.quaternion_multiply(qa, qb)), a @ b, atol=ROUNDING)
    left = rot.quaternion_multiply(rot.quaternion_multiply(qa, qb), qc)
    np.testing.assert_allclose(left, rot.quaternion_multiply(qa, rot.quaternion_multiply(qb, qc)), atol=ROUNDING)


@pytest.mark.parametrize("batch", BATCHES)
def test_batch_shapes(batch: tuple[int, ...]) -> None:
    v = np.random.default_rng(0).standard_normal((*batch, 3))
    m = rot.exp(v)
    q = rot.quaternion_from_matrix(m)
    assert m.shape == rot.skew(v).shape == rot.left_jacobian(v).shape == rot.passive_jacobian(v).shape == (*batch, 3, 3)
    assert rot.log(m).shape == rot.passive_vector(m).shape == (*batch, 3)
    assert q.shape == rot.xyzw_from_wxyz(q).shape == (*batch, 4)
    assert rot.angle_between(m, m).shape == batch


def test_quaternions_are_scipy() -> None:
    m = rot.exp(np.concatenate([vectors(20), np.pi * np.eye(3)]))
    q = rot.quaternion_from_matrix(m)
    theirs = rot.wxyz_from_xyzw(Rotation.from_matrix(m).as_quat())
    same = np.sign(np.sum(q * theirs, axis=-1, keepdims=True))
    np.testing.assert_allclose(q, same * theirs, atol=ROUNDING)
    np.testing.assert_allclose(rot.matrix_from_quaternion(q), m, atol=ROUNDING)
    assert (q[:, 0] >= 0).all()


def test_quaternion_order() -> None:
    q = np.array([1.0, 2.0, 3.0, 4.0])
    np.testing.assert_array_equal(rot.xyzw_from_wxyz(q), [2, 3, 4, 1])
    np.testing.assert_array_equal(rot.wxyz_from_xyzw(rot.xyzw_from_wxyz(q)), q)


def test_skew_is_the_cross_product() -> None:
    a, b = np.random.default_rng(0).standard_normal((2, 10, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", rot.skew(a), b), np.cross(a, b), atol=ROUNDING)


def finite_difference_jacobian(v: Floats, step: float) -> Floats:
    """Columns (Log(Exp(v + h e) Exp(v - h e)^T)) / 2h: central differences of the definition of J_l."""
    columns = []
    for axis in np.eye(3):
        ahead, behind = rot.exp(v + step * axis), rot.exp(v - step * axis)
        columns.append(rot.log(ahead @ np.swapaxes(behind, -1, -2)) / (2 * step))
    return np.stack(columns, axis=-1)


def test_left_jacobian_by_finite_differences() -> None:
    v = vectors(5)
    # Central differences with h = 1e-5: h^2 / 6 = 2e-11 of truncation, 1e-16 / h = 1e-11 of rounding.
    np.testing.assert_allclose(rot.left_jacobian(v), finite_difference_jacobian(v, 1e-5), atol=1e-10)


def test_passive_convention() -> None:
    phi = vectors(5)[-30:]
    angle = np.linalg.norm(phi, axis=-1)[:, None, None]
    e = phi / angle[:, 0]
    outer, cross = e[:, :, None] * e[:, None, :], rot.skew(e)
    paper_5 = np.cos(angle) * np.eye(3) + (1 - np.cos(angle)) * outer - np.sin(angle) * cross
    np.testing.assert_allclose(rot.matrix_from_passive_vector(phi), paper_5, atol=ROUNDING)
    ratio = np.sin(angle) / angle
    paper_9 = ratio * np.eye(3) + (1 - ratio) * outer + (np.cos(angle) - 1) / angle * cross
    np.testing.assert_allclose(rot.passive_jacobian(phi), paper_9, atol=ROUNDING)
    np.testing.assert_allclose(rot.passive_vector(paper_5), phi, atol=1e-14)


def test_angle_between() -> None:
    a = random((50,))
    for angle in (0.0, 1e-7, 1.0, np.pi - 1e-7):
        b = rot.exp(angle * np.array([0.6, 0.0, 0.8])) @ a
        np.testing.assert_allclose(rot.angle_between(b, a), angle, atol=ROUNDING)


def test_mean_rotation_is_scipy() -> None:
    samples = rot.exp(0.3 * np.random.default_rng(0).standard_normal((100, 3))) @ random(())
    theirs = Rotation.from_matrix(samples).mean().as_matrix()
    # Two different eigenvalue problems for the same chordal mean.
    np.testing.assert_allclose(rot.mean_rotation(samples), theirs, atol=1e-13)


def test_kernels_are_the_numpy_forms() -> None:
    out, product = np.empty((3, 3)), np.empty((3, 3))
    for v in vectors(3):
        rot.exp_into(v, out)
        np.testing.assert_allclose(out, rot.exp(v), atol=ROUNDING)
    a, b = random((2,))
    rot.multiply_into(a, b, product)
    np.testing.assert_allclose(product, a @ b, atol=ROUNDING)


def test_quaternion_kernels_are_the_array_forms() -> None:
    matrix, quaternion = np.empty((3, 3)), np.empty(4)
    for m in rot.exp(np.concatenate([vectors(5), np.pi * np.eye(3)])):
        rot.quaternion_from_matrix_into(m, quaternion)
        np.testing.assert_allclose(quaternion, rot.quaternion_from_matrix(m), atol=ROUNDING)
        rot.matrix_from_quaternion_into(quaternion, matrix)
        np.testing.assert_array_equal(matrix, rot.matrix_from_quaternion(quaternion))
        np.testing.assert_allclose(matrix, m, atol=ROUNDING)


def test_quaternion_between_is_the_product_with_the_conjugate() -> None:
    a, b = rot.quaternion_from_matrix(random((20,), 1)), rot.quaternion_from_matrix(random((20,), 2))
    between = [rot.quaternion_between(one, other) for one, other in zip(a, b, strict=True)]
    np.testing.assert_allclose(between, rot.quaternion_multiply(a, b * [1, -1, -1, -1]), atol=ROUNDING)


def test_turned_is_exp_times_the_vector() -> None:
    point = np.random.default_rng(3).standard_normal(3)
    for v in vectors(3):
        np.testing.assert_allclose(rot.turned(*v, *point), rot.exp(v) @ point, atol=ROUNDING)


def test_left_jacobian_kernel_is_the_array_form() -> None:
    out = np.empty((3, 3))
    for v in vectors(3):
        rot.left_jacobian_into(v, out)
        np.testing.assert_allclose(out, rot.left_jacobian(v), atol=ROUNDING)
