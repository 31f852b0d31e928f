"""BOP's MSSD and MSPD of a disc: the largest surface and projection distance at the best in-plane rotation.

A circle rotated about its normal is the same circle, so estimates do not determine the rotation. BOP therefore takes
the minimum, over an object's symmetries, of the largest displacement of its vertices, in space (MSSD) or image (MSPD):

    e = min over phi of max over t of |X'(t) - X(t + phi)|

with the true rim X and the estimated rim X'. Neither is sampled here: a rim is a short Fourier series in t (one
harmonic in space, a few in its image, which fall off like the ratio of radius to distance), so both optima are exact up
to rounding. T. Hodan et al., BOP Challenge 2020 on 6D object localization, ECCV Workshops 2020, section 2.2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.camera.model import Camera, project
from roundel.scenes.geometry.pose import minimal_rotation

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Number of rim points that determine the series of its image. For a circle one diameter away and tilted by 60 degrees,
# harmonics fall off by 0.23 each: the 15th is 3e-10.
_POINTS = 32
_NEGLIGIBLE = 1e-12  # fraction of the largest coefficient: smaller harmonics are left out
# If the rims differ by less than this fraction of the radius, the best rotation is within about that angle of zero, and
# the largest distance is convex there: each point's distance is a sinusoid of the rotation, within an eighth of a turn
# of its minimum. Otherwise rotations over the full turn are tried first; the minimum is then found, or missed by the
# effect of half a step on a rim, 0.13 radii.
_NEAR = 0.35
_TURNS = 24
_STEPS = 60
_GOOD = 1e-11  # relative accuracy of the squared distance
_ROWS = 4096  # rows at once: some tens of megabytes


def mssd_m(camera_from_marker: ArrayLike, normal: ArrayLike, centre_m: ArrayLike, radius_m: ArrayLike) -> Array:
    """Maximum symmetry-aware surface distance of a disc.

    Parameters
    ----------
    camera_from_marker : (..., 4, 4) array_like
        True pose.
    normal, centre_m : (..., 3) array_like
        Estimated pose.
    radius_m : (...) array_like

    Returns
    -------
    (...) array
        Metres; NaN if any input is NaN. With an exact centre it is 2 R sin(theta / 2) for an error theta of the normal;
        with an exact normal it is the error of the centre.
    """
    pose, n, c, radius = _broadcast(camera_from_marker, normal, centre_m, radius_m)
    axes = pose[..., :3, :2], _carried_axes(pose, n)
    shift = c - pose[..., :3, 3]
    series = []
    for (x, y), mean in zip(((a[..., 0], a[..., 1]) for a in axes), (np.zeros_like(shift), shift), strict=True):
        first = 0.5 * radius[..., None] * (x - 1j * y)
        series.append(np.stack([first.conj(), mean, first], axis=-1))
    return _least_farthest(np.asarray(series[1], dtype=np.complex128), np.asarray(series[0], dtype=np.complex128))


def mspd_px(
    camera_from_marker: ArrayLike, camera: Camera, normal: ArrayLike, centre_m: ArrayLike, radius_m: ArrayLike
) -> Array:
    """Maximum symmetry-aware projection distance of a disc, with both poses projected by one camera.

    Parameters
    ----------
    camera_from_marker : (..., 4, 4) array_like
        True pose.
    camera : Camera
        The camera that took the image, with its distortion; used for both estimate and truth, as in BOP.
    normal, centre_m : (..., 3) array_like
        Estimated pose.
    radius_m : (...) array_like

    Returns
    -------
    (...) array
        Pixels of the delivered image; NaN if a point of either rim has no image.
    """
    pose, n, c, radius = _broadcast(camera_from_marker, normal, centre_m, radius_m)
    t = np.arange(_POINTS) * (2 * np.pi / _POINTS)
    circle = np.stack([np.cos(t), np.sin(t)])
    images = []
    for axes, centre in ((pose[..., :3, :2], pose[..., :3, 3]), (_carried_axes(pose, n), c)):
        rim = centre[..., None, :] + radius[..., None, None] * np.swapaxes(axes @ circle, -1, -2)
        xy = project(camera, rim)
        images.append(xy[..., 0] + 1j * xy[..., 1])
    # Both are relative to a point near them, to keep the digits of differences of large coordinates.
    middle = images[0].mean(axis=-1, keepdims=True)
    true, estimate = (_series(image - middle)[..., None, :] for image in images)
    return _least_farthest(estimate, true)


def _broadcast(
    camera_from_marker: ArrayLike, normal: ArrayLike, centre_m: ArrayLike, radius_m: ArrayLike
) -> tuple[Array, Array, Array, Array]:
    pose = np.asarray(camera_from_marker, dtype=np.float64)
    n, c = np.asarray(normal, dtype=np.float64), np.asarray(centre_m, dtype=np.float64)
    radius = np.asarray(radius_m, dtype=np.float64)
    shape = np.broadcast_shapes(pose.shape[:-2], n.shape[:-1], c.shape[:-1], radius.shape)
    return (
        np.broadcast_to(pose, (*shape, 4, 4)),
        np.broadcast_to(n, (*shape, 3)),
        np.broadcast_to(c, (*shape, 3)),
        np.broadcast_to(radius, shape),
    )


def _carried_axes(pose: Array, normal: Array) -> Array:
    """Two axes (..., 3, 2) of the estimated plane, right-handed with its normal; their rotation does not matter."""
    true = pose[..., :3, 2]
    opposite = np.sum(true * normal, axis=-1) < -1 + 1e-9
    axes = minimal_rotation(true, np.where(opposite[..., None], true, normal)) @ pose[..., :3, :2]
    # Turned over about X.
    over = pose[..., :3, :2] * np.array([1.0, -1.0])
    return np.where(opposite[..., None, None], over, axes)


def _series(curve: Complex) -> Complex:
    """Fourier coefficients -K..K of a closed curve from its points, without negligible ones."""
    half = _POINTS // 2 - 1
    whole = np.fft.fft(curve, axis=-1) / _POINTS
    return np.asarray(np.concatenate([whole[..., -half:], whole[..., : half + 1]], axis=-1))


def _least_farthest(estimate: Complex, true: Complex) -> Array:
    """The metric for two curves (..., parts, 2 K + 1) given by their coefficients."""
    shape = true.shape[:-2]
    e, s = (a.reshape(-1, *a.shape[-2:]) for a in (estimate, true))
    known = np.isfinite(e).all(axis=(1, 2)) & np.isfinite(s).all(axis=(1, 2))
    out = np.full(len(e), np.nan)
    rows = np.flatnonzero(known)
    for part in np.array_split(rows, max(1, -(-len(rows) // _ROWS))):
        if len(part):
            out[part] = _least_of_rows(*_trimmed(e[part], s[part]))
    return out.reshape(shape)


def _trimmed(estimate: Complex, true: Complex) -> tuple[Complex, Complex]:
    size = np.maximum(np.abs(estimate), np.abs(true)).max(axis=1)
    top = size.max(axis=1, keepdims=True)
    needed = np.flatnonzero((size > _NEGLIGIBLE * top).any(axis=0))
    half = size.shape[1] // 2
    keep = max(1, int(np.abs(needed - half).max(initial=1)))
    return estimate[..., half - keep : half + keep + 1], true[..., half - keep : half + keep + 1]


def _least_of_rows(estimate: Complex, true: Complex) -> Array:
    half = true.shape[-1] // 2
    k = np.arange(-half, half + 1)
    count = max(16, 4 * half)
    t = np.arange(count) * (2 * np.pi / count)
    phi, reach = np.zeros(len(true)), np.full(len(true), _NEAR)
    gap, speed = (np.sqrt(_size2(c @ np.exp(1j * k[:, None] * t))) for c in (estimate - true, true * k))
    far = np.flatnonzero(gap.max(axis=1) > _NEAR * speed.min(axis=1))
    if len(far):
        turns = np.arange(_TURNS) * (2 * np.pi / _TURNS)
        tried = [_farthest(estimate[far], true[far], np.full(len(far), turn), k, t)[0] for turn in turns]
        phi[far], reach[far] = turns[np.argmin(tried, axis=0)], turns[1]
    # Bracket of the minimum: position, value, slope and curvature at both ends; an unvisited end has value -inf.
    low, high = (np.stack([phi + d * reach, 0 * phi - np.inf, 0 * phi + d, 0 * phi]) for d in (-1.0, 1.0))
    least, before, rows = np.full(len(true), np.inf), np.zeros(len(true)), np.arange(len(true))
    for _ in range(_STEPS):
        here = np.stack([phi, *_farthest(estimate[rows], true[rows], phi, k, t)])
        least[rows] = np.minimum(least[rows], here[1])
        side = np.where(here[2] < 0, -1.0, 1.0)
        low, high = np.where(side < 0, here, low), np.where(side < 0, high, here)
        # Two steps on the same side: the model of the other end is too inaccurate to use again.
        twice = side == before
        before = np.where(twice, 0.0, side)
        # Between its ends a convex function is above both tangents.
        cross = (high[1] - low[1] + low[2] * low[0] - high[2] * high[0]) / (low[2] - high[2])
        with np.errstate(invalid="ignore"):
            bottom = low[1] + low[2] * (cross - low[0])
        open_ = ~(least[rows] - bottom <= _GOOD * least[rows]) & (high[0] - low[0] > 1e-15)
        rows, before, twice, low, high = rows[open_], before[open_], twice[open_], low[:, open_], high[:, open_]
        if not len(rows):
            break
        phi = np.where(twice, 0.5 * (low[0] + high[0]), _least_of_model(low, high))
    return np.asarray(np.sqrt(least))


def _least_of_model(low: Array, high: Array) -> Array:
    """Minimiser of the maximum of two parabolas, each through one end of the bracket."""
    a, b = low[0], high[0]
    for _ in range(30):
        x = 0.5 * (a + b)
        u, v = x - low[0], x - high[0]
        from_low = low[1] + u * (low[2] + 0.5 * u * low[3])
        from_high = high[1] + v * (high[2] + 0.5 * v * high[3])
        slope = np.where(from_low > from_high, low[2] + u * low[3], high[2] + v * high[3])
        a, b = np.where(slope < 0, x, a), np.where(slope < 0, b, x)
    return np.asarray(0.5 * (a + b))


def _size2(points: Complex) -> Array:
    """|.|^2 over the parts of points (rows, parts, n)."""
    return np.asarray(np.sum(points.real**2 + points.imag**2, axis=1))


def _farthest(estimate: Complex, true: Complex, phi: Array, k: NDArray[Any], t: Array) -> tuple[Array, Array, Array]:
    """Largest squared distance at rotation `phi` of each row, with its slope and curvature in phi."""
    turned = true * np.exp(1j * phi[:, None] * k)[:, None, :]
    gap = estimate - turned
    modes = gap.shape[-1]
    # The squared distance is also a series in t: its coefficients are the autocorrelation of those of the gap.
    power = np.stack(
        [np.sum(gap[..., m:] * gap[..., : modes - m].conj(), axis=(1, 2)) * (2 if m else 1) for m in range(modes)]
    )
    order = np.arange(modes)[:, None]
    sampled = (power.T @ np.exp(1j * order * t)).real
    first = np.argmax(sampled, axis=1)
    # It has two maxima, rarely more: the best sample, and the best one separated from it.
    apart = np.abs((np.arange(len(t)) - first[:, None] + len(t) // 2) % len(t) - len(t) // 2) > 2
    second = np.argmax(np.where(apart, sampled, -1.0), axis=1)
    best, place = np.full(len(gap), -1.0), t[first]
    for start in (first, second):
        where = t[start]
        for _ in range(3):
            z = np.exp(1j * where)
            d1, d2 = -_sum(power * order, z).imag, -_sum(power * order**2, z).real
            newton = np.where(d2 < 0, -d1 / np.where(d2 < 0, d2, -1.0), np.sign(d1) * t[1])
            where = where + np.clip(newton, -t[1], t[1])
        value = _sum(power, np.exp(1j * where)).real
        better = value > best
        best, place = np.where(better, value, best), np.where(better, where, place)
    wave = np.exp(1j * place[:, None] * k)
    v, v1, v2 = (np.einsum("rpk,rk->rp", gap, wave * (1j * k) ** n) for n in range(3))
    w1, w2 = (np.einsum("rpk,rk->rp", turned, wave * (1j * k) ** n) for n in (1, 2))
    # Computed from the gap itself, because the series of its square loses half of the digits of small values.
    value = _dot(v, v)
    # Half the derivatives of |v|^2 in t and phi; the position of the maximum moves with phi.
    tt, tf, ff = _dot(v1, v1) + _dot(v, v2), -_dot(v1, w1) - _dot(v, w2), _dot(w1, w1) - _dot(v, w2)
    curvature = ff - np.where(tt < 0, tf * tf / np.where(tt < 0, tt, -1.0), 0.0)
    return value, -2.0 * _dot(v, w1), 2 * np.maximum(curvature, 0.0)


def _dot(a: Complex, b: Complex) -> Array:
    """Real part of the scalar product of (rows, parts)."""
    return np.asarray(np.sum(a.real * b.real + a.imag * b.imag, axis=1))


def _sum(coefficients: Complex, z: Complex) -> Complex:
    """sum_m c_m z^m of coefficients (modes, rows), by Horner's rule."""
    total = np.zeros_like(z)
    for c in coefficients[::-1]:
        total = total * z + c
    return total
