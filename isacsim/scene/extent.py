"""What a detection says of a vehicle that has a length: which of its points it may be of, and how sure that is.

A track's state has the length as its seventh component. A detection is of the vehicle's five points by how strong each
is from there and how near it lies. Its expectation is their mean, and their spread joins its covariance: where one end
alone answers, the detection is as good as that end's; where it may be of any point, it is as good as the body is long.
The unknown point stays the same for several instants, which is why the spread counts `LASTS` times.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.blockage import CAR_HEIGHT_M, TRUCK_HEIGHT_M
from isac_cosim.isacsim.scene.bodies import BEHIND, look

CAR_M, CAR_SD_M = 4.6, 0.4
"""Length that a vehicle is taken to have at first, and its standard deviation, m."""
SHORTEST_M, LONGEST_M, LONG_M = 3.0, 19.0, 7.0
"""Lengths that are possible, and from which on a vehicle is wide and high, m."""
CAR_WIDTH_M, LONG_WIDTH_M = 1.8, 2.5
LENGTH_SD_M = 0.02
"""How much the length's deviation grows in a second, m: it is constant, but the points are not exactly where they are
taken to be."""
OFF_ACROSS_M, OFF_ALONG_M, OFF_MPS = 0.15, 0.3, 0.02
"""How far what answers is off its point: across the line of sight and along it, m, and in radial velocity, m/s, beside
what the first one changes of it."""
ASTRAY = np.array([0.5, 0.5, 0.15])
"""The same where it is not known whose a detection is: it may lie between two points."""
HEAVY_TAILS = 4.0
"""Degrees of freedom of detections' Student's t distribution: some are far off, as two echoes in one cell."""
LASTS, SLOW_MPS, SLOWEST_MPS = 10.0, 10.0, 0.1
"""Number of instants for which the same point answers; below the first speed, inversely proportional to the speed,
which is taken for the second one at least."""
CLEAR_SHARE, CLEAR_COSINE = 0.5, 0.5
"""An end is told from the other points where its share of the power is larger, and the cosine of the line of sight to
the vehicle's axis is."""
AVERAGED, ASTRAY_END_M, ASTRAY_END_SHARE = 12.0, 2.0, 0.25
"""Number of instants over which an end's error is averaged, and the largest one, m and as a share of the length, that
the filter puts right itself."""
WEAKEST = 0.02
"""Least share of a point."""


@dataclass(frozen=True)
class Expected:
    """What I panels should measure of T tracks' J points.

    measured: sine, slant range (m), radial velocity (m/s), (T, I, J, 3). share: of each point in the power, (T, I, J).
    middle: mean over the points by their shares, (T, I, 3). behind: how far behind the front bumper the points are,
    lengths, (J,). ahead: unit vector of the heading, (T, 2).
    """

    measured: Array
    share: Array
    middle: Array
    behind: Array
    ahead: Array


def size_of_length(length: Array) -> Array:
    """Return length, width and height that vehicles of a length are taken to have, m, (T,) -> (T, 3)."""
    long = length > LONG_M
    width, height = np.where(long, LONG_WIDTH_M, CAR_WIDTH_M), np.where(long, TRUCK_HEIGHT_M, CAR_HEIGHT_M)
    return np.stack([length, width, height], axis=1)


def expected(state: Array, ahead: Array, panels: Panels, bodies: bool) -> Expected:
    """Return what panels should measure of tracks. state: with the length, (T, 7). ahead: (T, 2)."""
    if not bodies:
        points = look(state[:, :4], ahead, None, panels)
        ones = np.ones(points.measured.shape[:3])
        return Expected(points.measured, ones, points.measured[:, :, 0], np.zeros(1), ahead)
    points = look(state[:, :4], ahead, size_of_length(state[:, 6]), panels)
    power = 10 ** (points.strength_dbsm() / 10) / points.measured[..., 1] ** 4
    share = power / power.sum(axis=-1, keepdims=True)
    middle = (share[..., None] * points.measured).sum(axis=2)
    return Expected(points.measured, share, middle, BEHIND, ahead)


def between_points(middle: Array, speed: Array) -> Array:
    """Return the variance of panels' detections about tracks' points that they may lie between, (T, I, 3).

    middle: what the panels should measure, (T, I, 3). speed: of the tracks, m/s, (T,).
    """
    sine = (ASTRAY[0] / middle[..., 1]) ** 2
    turning = np.maximum(speed[:, None] ** 2 - middle[..., 2] ** 2, 0.0)
    return np.stack([sine, np.full(sine.shape, ASTRAY[1] ** 2), ASTRAY[2] ** 2 + sine * turning], axis=-1)


def off_its_point(rows: Array) -> Array:
    """Return the covariance of detections because what answers is off its point, but for `OFF_MPS`, (n, 3, 3).

    Abreast of a panel, a point farther ahead changes the sine and the radial velocity together; along the line of
    sight, none of the two. rows: of `rows_at`, (n, 3, 5).
    """
    of_place = rows[:, :, :2]
    sight = of_place[:, 1]
    along = sight[:, :, None] * sight[:, None]
    off = OFF_ACROSS_M**2 * np.eye(2) + (OFF_ALONG_M**2 - OFF_ACROSS_M**2) * along
    return np.asarray(of_place @ off @ of_place.transpose(0, 2, 1))


def robust_weight(surprise: Array, covariance: Array) -> Array:
    """Return the weight of n detections among such as are not far off, at most 1, (n,).

    It is that of the expectation maximisation for Student's t distribution. surprise: (n, 3). covariance: of it,
    (n, 3, 3). Source: Roth, Özkan and Gustafsson, A Student's t filter for heavy tailed process and measurement noise,
    ICASSP 2013.
    """
    distance = (surprise * np.linalg.solve(covariance, surprise[..., None])[..., 0]).sum(axis=1)
    return np.asarray(np.minimum(1.0, (HEAVY_TAILS + surprise.shape[1]) / (HEAVY_TAILS + distance)))


def matched(surprise: Array, variance: Array, points: Array, share: Array, behind: Array) -> tuple[Array, Array, Array]:
    """Return the expectation of n detections given that they are there, its covariance, and the mean of `behind`.

    surprise: of each detection to each point, (n, J, 3). variance: of both, (n, 3). points: what each point should
    give, (n, J, 3). share: (n, J). Returns (n, 3), (n, 3, 3) and (n,).
    """
    log = np.log(np.maximum(share, WEAKEST)) - (surprise**2 / variance[:, None]).sum(axis=-1) / 2
    weight = np.exp(log - log.max(axis=1, keepdims=True))
    weight /= weight.sum(axis=1, keepdims=True)
    mean = (weight[..., None] * points).sum(axis=1)
    apart = points - mean[:, None]
    return mean, (weight[..., None] * apart).transpose(0, 2, 1) @ apart, weight @ behind


def rows_at(measured: Array, behind: Array, track: IntArray, panel: IntArray, state: Array, of: Expected,
            panels: Panels) -> Array:  # fmt: skip
    """Return the derivatives of what n detections measure with respect to x, y, vx, vy and the length, (n, 3, 5).

    measured: expected, (n, 3). behind: how far behind the front bumper, lengths, (n,). state: of all tracks, (T, 7).
    """
    ahead, right = of.ahead[track], panels.right[panel]
    place = state[track, :2] - (behind * state[track, 6])[:, None] * ahead
    sine, distance, radial = (measured[:, k, None] for k in range(3))
    unit = np.stack([place[:, 0] - panels.x[panel], place[:, 1] - panels.y[panel]], axis=1) / distance
    rows = np.zeros((len(track), 3, 5))
    rows[:, 0, :2] = (right - sine * unit) / distance
    rows[:, 1, :2] = unit
    rows[:, 2, :2] = (state[track, 2:4] - radial * unit) / distance
    rows[:, 2, 2:4] = unit
    rows[:, :, 4] = -behind[:, None] * (rows[:, :, :2] * ahead[:, None]).sum(axis=-1)
    return rows


def astray(
    surprise: Array, power: Array, share: Array, pairs: tuple[IntArray, IntArray], of: Expected, panels: Panels,
    place: Array, before: Array,
) -> Array:  # fmt: skip
    """Return how far the two ends of tracks are off where the strongest echo of each panel says, m, averaged, (T, 2).

    An end that faces a panel is the strongest point by far, which tells it from the others even where a detection lies
    nearer to one of these. surprise: of n detections to each point, (n, J, 3). power: (n,). share: of the points,
    (n, J). pairs: track and panel of each, (n,). place: of the tracks' middles, m, (T, 2). before: the average up to
    now.
    """
    track, panel = pairs
    order = np.lexsort((power, panel, track))
    last = np.append((np.diff(track[order]) != 0) | (np.diff(panel[order]) != 0), True)
    strongest = order[last]
    track, panel, share = track[strongest], panel[strongest], share[strongest]
    dx, dy = place[track, 0] - panels.x[panel], place[track, 1] - panels.y[panel]
    cosine = (of.ahead[track, 0] * dx + of.ahead[track, 1] * dy) / of.middle[track, panel, 1]
    result = before.copy()
    for end in (0, 1):
        clear = (share[:, end] > CLEAR_SHARE) & (np.abs(cosine) > CLEAR_COSINE)
        count = np.bincount(track[clear], minlength=len(before))
        along = surprise[strongest[clear], end, 1] / cosine[clear]
        mean = np.bincount(track[clear], along, len(before)) / np.maximum(count, 1)
        result[:, end] = np.where(count > 0, before[:, end] + (mean - before[:, end]) / AVERAGED, before[:, end])
    return result


def ends_put_right(state: Array, covariance: Array, ahead: Array, off: Array) -> None:
    """Move the ends of tracks to where their echoes come from if these are far off, in place; `off` is then zero.

    A length that is then a car's is taken to be as certain as a car's is beforehand.
    """
    largest = np.maximum(ASTRAY_END_M, ASTRAY_END_SHARE * state[:, 6])
    wrong = np.flatnonzero(np.abs(off).max(axis=1, initial=0.0) > largest)
    state[wrong, :2] += off[wrong, :1] * ahead[wrong]
    state[wrong, 6] = np.clip(state[wrong, 6] + off[wrong, 0] - off[wrong, 1], CAR_M, LONGEST_M)
    covariance[wrong, :2, :2] += np.eye(2) * 0.5
    covariance[wrong, 6, :] = covariance[wrong, :, 6] = 0.0
    state[wrong, 6], covariance[wrong, 6, 6] = with_class(state[wrong, 6], 1.0)
    off[wrong] = 0.0


def with_class(length: Array, variance: float) -> tuple[Array, Array]:
    """Return lengths that are known anew, m, (n,), and their variance: those of cars, together with what cars are like.

    Without it, a car whose far end nobody sees could get any length up to `LONG_M`, and keep it: the end's echoes
    would be taken for its sides'.
    """
    share = variance / (variance + CAR_SD_M**2)
    long = length > LONG_M
    return np.where(long, length, length + share * (CAR_M - length)), np.where(long, variance, share * CAR_SD_M**2)
