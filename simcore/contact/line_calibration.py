"""What the mesh owes to the compliance of a needle's line: G = G_cylinder + (u of quadratic - u of linear elements).

u is the mean deflection, per line load, of the balls along a straight line from the entry inwards, across and along it.
The load acts through the same balls as a needle's. Quadratic elements stand for the limit of fine meshes;
they contain the linear ones, so what they give way more is never negative. Determined once for a mesh, its held nodes,
Poisson's ratio, the ball and the entry; it scales with 1 / E.
"""

from __future__ import annotations

import hashlib
import json
import os
from typing import TYPE_CHECKING

import numpy as np

from simcore.compiled import user_cache
from simcore.contact.kernels import frame_along
from simcore.linear_algebra.products import norm, product, times
from simcore.tissue.quadratic import CORNERS, QuadraticTissue, quadratic_shapes

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from simcore.arrays import Floats, Ints
    from simcore.contact.channel import ChannelModel
    from simcore.tissue.model import TissueModel

DIGITS = 6  # kept of the result: its conjugate gradients stop at the ninth
PER_RADIUS = 2  # balls along the line within a radius
SCHEME = "line 2"  # of the calibration: part of the name under which a result is kept
_found: dict[str, Floats] = {}


def mesh_deficit(tissue: TissueModel, channel: ChannelModel, entry_m: Floats) -> Floats:
    """(3, 3) m2/N, world, symmetric and not negative: deflection per line load that the linear mesh owes.

    Kept in memory and in the user's cache folder.
    """
    key = _key(tissue, channel, entry_m)
    if key not in _found:
        file = user_cache() / f"line-{key}.json"
        _found[key] = _read(file) if file.exists() else _computed(tissue, channel, entry_m, file)
    return _found[key] / tissue.mu_pa


def _key(tissue: TissueModel, channel: ChannelModel, entry_m: Floats) -> str:
    """Of all that the result depends on; Poisson's ratio as lambda / mu."""
    digest = hashlib.sha256(SCHEME.encode())
    rule = channel.ball.rule
    ratio = np.array([round(tissue.lambda_pa / tissue.mu_pa, 12)])
    for array in (tissue.mesh.nodes_m, tissue.mesh.tets, tissue.unknown, rule.offsets_m, rule.strength, entry_m, ratio):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]


def _read(file: Path) -> Floats:
    return np.array(json.loads(file.read_text(encoding="ascii")))


def _computed(tissue: TissueModel, channel: ChannelModel, entry_m: Floats, file: Path) -> Floats:
    """Mu times the result: (3, 3), without a unit. A folder that cannot be written only costs time."""
    found = _rounded(deficit_along(tissue, channel, line_of_balls(channel, tissue, entry_m)) * tissue.mu_pa)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        partial = file.with_suffix(f".{os.getpid()}-{id(found)}.partial")
        partial.write_text(json.dumps(found.tolist()), encoding="ascii")
        partial.replace(file)
    except OSError:
        pass
    return found


def _rounded(values: Floats) -> Floats:
    """To so many digits of the largest; both halves alike."""
    halves, largest = 0.5 * (values + values.T), float(np.abs(values).max())
    decimals = DIGITS - 1 - int(f"{largest:e}".partition("e")[2])
    return np.array([[round(value, decimals) for value in row] for row in halves.tolist()])


def line_of_balls(channel: ChannelModel, tissue: TissueModel, entry_m: Floats) -> Floats:
    """(k, 3) m: centres of whole balls on the way from the entry straight through the tissue."""
    radius = channel.ball.radius_m
    step = radius / PER_RADIUS
    farthest = norm(np.ptp(tissue.mesh.nodes_m, axis=0))
    depths = np.arange(radius, max(farthest, 2.0 * radius), step)
    centres: Floats = entry_m + depths[:, None] * channel.inward
    outside = np.flatnonzero(tissue.mesh.outside_by(centres + radius * channel.inward) > 1e-9)
    return centres[: max(1, int(outside[0]))] if len(outside) else centres


def deficit_along(tissue: TissueModel, channel: ChannelModel, centres_m: Floats) -> Floats:
    """(3, 3) m2/N: see `mesh_deficit`; centres_m (k, 3): of the balls, their distance the length that each stands for.

    Raises ArithmeticError where the reference does not converge."""
    frame = np.empty((3, 3))
    frame_along(channel.inward, frame)
    quadratic = QuadraticTissue.of(tissue)
    weights = line_weights(quadratic, channel, centres_m)
    length_m = len(centres_m) * channel.ball.radius_m / PER_RADIUS
    owed = np.empty((3, 3))
    for a in range(3):
        exact, linear = quadratic.solve(length_m * weights[:, None] * frame[a])
        owed[a] = times(frame, times((exact - linear).T, weights))
    return product(product(frame.T, owed), frame)


def line_weights(quadratic: QuadraticTissue, channel: ChannelModel, centres_m: Floats) -> Floats:
    """(n + e,) weights of the quadratic nodes in the mean of the balls at centres_m (k, 3), which add up to 1."""
    mesh, numbers, rule = quadratic.linear.mesh, _numbers_of_edges(quadratic), channel.ball.rule
    weights, shares = np.zeros(len(quadratic.held)), rule.strength / rule.strength.sum()
    for centre in centres_m:
        located = [mesh.locate(point) for point in centre + rule.offsets_m]
        nodes, linear = np.array([found[0] for found in located]), np.array([found[1] for found in located])
        midside = numbers(nodes)
        np.add.at(weights, np.hstack([nodes, midside]), (shares[:, None] * quadratic_shapes(linear)) / len(centres_m))
    return weights


def _numbers_of_edges(quadratic: QuadraticTissue) -> Callable[[Ints], Ints]:
    """A function from corners (k, 4) of tetrahedra to the numbers (k, 6) of their midside nodes."""
    n = len(quadratic.linear.mesh.nodes_m)
    codes = quadratic.edges[:, 0] * n + quadratic.edges[:, 1]

    def numbers(nodes: Ints) -> Ints:
        pairs = np.sort(nodes[:, CORNERS], axis=2)
        found: Ints = n + np.searchsorted(codes, pairs[..., 0] * n + pairs[..., 1])
        return found

    return numbers
