"""Parts of the page of `oma` that are no plots: moving shapes, and modes that are marked by hand."""

import json
from typing import Any

import numpy as np

from windsysid._types import Array
from windsysid.modal.shapes import along_axis
from windsysid.reports.html import static_text, template
from windsysid.spectral.oma.result import OperationalModes
from windsysid.spectral.oma.sensors import Node

__all__ = ["complex_planes", "marks_form", "moving_shapes", "page_script"]


def page_script() -> str:
    """Script of both parts."""
    return f"<script>{static_text('oma.js')}</script>"


def marks_form(found: OperationalModes) -> str:
    """Form in which modes are added and removed by hand; it saves the file that `--modes` reads."""
    return template("oma").render(part="marks", modes=found.modes, record=" ".join(found.record.split()))


def complex_planes(found: OperationalModes) -> str:
    """Components of each shape in the complex plane, turned so that the line that fits them best is the real axis."""
    ends = [[(100.0 * z.real, -100.0 * z.imag) for z in along_axis(mode.shape)] for mode in found.modes]
    return template("oma").render(part="planes", modes=zip(found.modes, ends, strict=True))


def moving_shapes(found: OperationalModes) -> str:
    """Figure in which the shape of a mode moves; empty if no sensor has a position and a direction."""
    nodes = _nodes(found)
    if not found.modes or not nodes:
        return ""
    names = [f"{mode.name}, {mode.frequency.estimate:.4g} Hz" for mode in found.modes]
    return template("oma").render(
        part="shapes", names=names, spec=json.dumps(_shapes(found, nodes)).replace("<", "\\u003c")
    )


def _shapes(found: OperationalModes, nodes: list[Node]) -> dict[str, object]:
    """Nodes, lines and motions as the script takes them."""
    placed = {_node_of(found, c) for c in range(len(found.channels))}
    at = {node.name: i for i, node in enumerate(nodes)}
    place = np.array([node.position for node in nodes])
    return {
        "points": place.tolist(),
        "measured": [node.position in placed for node in nodes],
        "lines": [[at[a], at[b]] for a, b in found.lines_drawn],
        "span": float(np.ptp(place, axis=0).max()) or 1.0,
        "modes": [{"motion": _motion(found, nodes, m)} for m in range(len(found.modes))],
    }


def _nodes(found: OperationalModes) -> list[Node]:
    """Nodes of the geometry, and positions of sensors that are none of them."""
    nodes, known = list(found.nodes), {node.position for node in found.nodes}
    for c in range(len(found.channels)):
        place = _node_of(found, c)
        if place is not None and place not in known:
            known.add(place)
            nodes.append(Node(name=f"channel {found.channels[c]}", position=place))
    return nodes if any(_node_of(found, c) is not None for c in range(len(found.channels))) else []


def _node_of(found: OperationalModes, channel: int) -> tuple[float, float, float] | None:
    sensor = found.sensors[channel]
    return None if sensor is None or sensor.direction is None else sensor.position


def _motion(found: OperationalModes, nodes: list[Node], mode: int) -> list[Any]:
    """Real and imaginary part of each node's motion in x, y and z; a node that follows another one has its motion."""
    shape = along_axis(found.modes[mode].shape)
    by_place: dict[tuple[float, ...], Array] = {}
    for c, value in enumerate(shape):
        place, sensor = _node_of(found, c), found.sensors[c]
        if place is not None and sensor is not None and sensor.direction is not None:
            way = np.array(sensor.direction) / np.linalg.norm(sensor.direction)
            by_place[place] = by_place.get(place, np.zeros((3, 2))) + way[:, None] * [value.real, value.imag]
    named = {node.name: node for node in nodes}
    rest = np.zeros((3, 2))
    return [
        by_place.get(named[node.follows].position if node.follows else node.position, rest).tolist() for node in nodes
    ]
