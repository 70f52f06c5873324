"""Data of [[target]] and [[stage]]: lengths, supports, positions, active elements, loads.

Rank 0, global order.

A change by a [m] makes each cable longer by a, each of its elements in proportion to its unstressed length.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple, final

import numpy as np

from netfall.core.errors import raise_errors
from netfall.core.messages import kN
from netfall.driver import messages
from netfall.geometry.net import (
    Net,
    connected_parts,
    elements_of_cables,
    elements_of_group,
    extend_to_inner_particles,
    parent_ends,
    part_contains,
)
from netfall.geometry.turned import global_held_axes, is_guided, is_rotated, settlement_axes
from netfall.geometry.zones import is_node_id, nodes_named
from netfall.job.derived import has_statics, load_settings
from netfall.job.job import Job
from netfall.job.keys.entries import Stage, action_factor, apply_settings, axes_by_name, setting_of
from netfall.job.keys.models import Load
from netfall.job.values import counted, format_list, format_value, suggest
from netfall.loads.loads import GivenLoads, dead_load, live_load
from netfall.model.layout import Layout
from netfall.model.model import Model

MIN_TAUT_FORCE = 1e-6  # force over EA [-] at which a slack cable becomes taut


class Jack(NamedTuple):
    """Group of cables whose unstressed lengths change by one common amount [m].

    name : of the group or cable; rows : (r,) elements; cable : (r,) number of the cable of each, from 0
    """

    name: str
    rows: np.ndarray
    cable: np.ndarray

    def shares(self, L0: np.ndarray) -> np.ndarray:
        """Return the share of each element (r,) in the amount, at unstressed lengths L0 (m,) [m]."""
        return L0[self.rows] / np.bincount(self.cable, L0[self.rows])[self.cable]

    def changed(self, L0: np.ndarray, amount: float) -> np.ndarray:
        """Return unstressed lengths (m,) [m] after a change by an amount [m]."""
        L0 = L0.copy()
        L0[self.rows] += amount * self.shares(L0)
        return L0


class NetTarget(NamedTuple):
    """Target in the net: the mean force [N] of elements `rows`, or the height [m] of a node.

    name : in messages; node : its row, -1: a force; jack : number of the jack at which it is measured, -1:
    no jack
    """

    name: str
    value: float
    rows: np.ndarray
    node: int = -1
    jack: int = -1

    @property
    def text(self) -> str:
        """Return the target and its value as text."""
        return f"{self.name} = {self.format(self.value)}"

    def format(self, value: float) -> str:
        """Return a value with the unit of the target."""
        return f"{value:.6g} m" if self.node >= 0 else kN(value, digits=6)

    def value_at(self, x: np.ndarray, N: np.ndarray) -> float:
        """Return the value with nodes at x (n, 3) [m] and axial forces N (m,) [N]."""
        if self.node >= 0:
            return float(x[self.node, 2])
        return float(np.bincount(np.zeros(len(self.rows), int), N[self.rows])[0] / len(self.rows))


def rows_named(net: Net, name: str) -> np.ndarray:
    """Return the elements of a group or of a cable; empty if the name is unknown."""
    rows, wrong = elements_of_group(net, name)
    return elements_of_cables(net, [name])[0] if wrong else rows


def jack_of(net: Net, name: str) -> Jack:
    """Return one jack for all cables with a name; all have the same amount."""
    rows = rows_named(net, name)
    return Jack(name, rows, np.unique(net.cable[rows], return_inverse=True)[1])


def jacks_of(net: Net, name: str) -> list[Jack]:
    """Return a jack for each cable with a name, with separate amounts."""
    rows = rows_named(net, name)
    cables = [rows[net.cable[rows] == cable] for cable in dict.fromkeys(net.cable[rows].tolist())]
    return [
        Jack(net.cable_names[net.cable[cable_rows[0]]], cable_rows, np.zeros(len(cable_rows), int))
        for cable_rows in cables
    ]


def unknown_name(net: Net, place: str, name: str) -> str:
    """Return the error in the name of a group or a cable; "": none. place : of the name in the job"""
    if len(rows_named(net, name)):
        return ""
    suggestion = suggest(name, [*(group for group in net.group_names if group), *net.cable_names])
    return messages.UNKNOWN_NAME(place=place, name=format_value(name), suggestion=suggestion)


def amount_until_taut(jack: Jack, L: np.ndarray, L0: np.ndarray, EA: np.ndarray, force: float) -> float:
    """Compute the amount [m] after which a slack cable would carry a force [N] at its present nodes.

    L, L0 : (m,) [m] lengths, unstressed lengths; EA : (m,) [N]
    """
    rows = jack.rows
    force_to_reach = max(force, MIN_TAUT_FORCE * float(EA[rows].min()))
    return float((L[rows] / (1.0 + force_to_reach / EA[rows]) - L0[rows]).sum()) / (1 + int(jack.cable.max()))


@final
@dataclass(frozen=True)
class StageSetting:
    """Setting of a stage, including unchanged settings of earlier stages.

    L0 : (m,) [m], cold; slipped : (m,) share of it that slips in earlier stages added
    fixed : (n, 3) bool; active : (m,) bool; moved : (n, 3) [m] relative to the present positions
    load : values of [load]; load_table : loads of the stage's table, None: none
    force_targets : target forces, each at a separate jack in `jacks`
    clamps : "open" or "closed"
    """

    L0: np.ndarray
    slipped: np.ndarray
    fixed: np.ndarray
    active: np.ndarray
    moved: np.ndarray
    load: Load
    load_table: GivenLoads | None = None
    force_targets: tuple[NetTarget, ...] = ()
    jacks: tuple[Jack, ...] = ()
    clamps: str = "closed"

    def held(self, net: Net) -> np.ndarray:
        """Return the held axes (n, 3) bool, with those of nodes without elements."""
        return self.fixed | ~self.has_elements(net)[:, None]

    def has_elements(self, net: Net) -> np.ndarray:
        """Return which nodes have elements, (n,) bool."""
        return np.bincount(net.elements[self.active].ravel(), minlength=net.n) > 0

    def forces(self, model: Model, x: np.ndarray) -> np.ndarray:
        """Compute the loads (n, 3) [N] at x (n, 3) [m]: weight of active elements, others at their nodes."""
        net, roof = model.net, model.roof_at(x)
        if roof.slender is not None:
            roof = replace(roof, slender=roof.slender.lengthened(np.where(self.active, self.L0, 0.0)))
        nodes = model.layout.loads.forces(net, self.L0, self.active)
        if self.load_table is not None:
            nodes = nodes + self.load_table.forces(net, self.L0, self.active)
        full_load = live_load(self.load, roof, nodes) + dead_load(self.load, roof)
        load = np.where(self.has_elements(net)[:, None], full_load, 0.0)
        if self.load.self_weight:
            half = np.where(self.active, 0.5 * net.own_weight * self.L0, 0.0)
            for end in range(2):
                load[:, 2] -= np.bincount(net.elements[:, end], half, net.n)
        return load


def first_setting(job: Job, model: Model) -> StageSetting:
    """Return the setting before any stage: the complete net under [load]."""
    net = model.net
    all_elements, no_motion = np.ones(net.m, bool), np.zeros_like(net.x)
    return StageSetting(
        model.cut_length, np.zeros(net.m), net.fixed, all_elements, no_motion, load_settings(job)
    )


def next_setting(previous: StageSetting, stage: Stage, layout: Layout) -> StageSetting:
    """Return the setting of the stage that follows."""
    net = layout.net
    groups = None if stage.active is None else [net.group_names.index(name) for name in stage.active]
    active = previous.active if groups is None else np.isin(net.group, groups)
    released = _axes(layout, axes_by_name(stage.release))
    # inner nodes that were fixed between two fixed ends are released with an end
    released |= released[parent_ends(net)].any(1) & net.fixed
    fixed = previous.fixed & ~released | _axes(layout, axes_by_name(stage.hold))
    motion = np.zeros_like(net.x)
    for name, displacement in (stage.move or {}).items():
        motion[_moved_nodes(layout, fixed, name)] = displacement
    L0 = previous.L0
    force_targets: list[NetTarget] = []
    jacks: list[Jack] = []
    for name, change in (stage.lengths or {}).items():
        own_jacks = jacks_of(net, name)
        if change.change is not None:
            L0 = jack_of(net, name).changed(L0, change.change)
        elif change.length is not None:
            for jack in own_jacks:
                L0 = jack.changed(L0, change.length - float(L0[jack.rows].sum()))
        elif change.force is not None:
            first = len(jacks)
            force_targets += [
                NetTarget(f"force of {jack.name}", change.force, jack.rows, jack=first + k)
                for k, jack in enumerate(own_jacks)
            ]
            jacks += own_jacks
    load, clamps = apply_settings(previous.load, "load", stage.set), stage.clamps or previous.clamps
    table = previous.load_table
    if stage.load_table is not None:
        table = layout.load_tables.get(stage.load_table)
    motion = extend_to_inner_particles(net, motion, fixed)
    return StageSetting(
        L0, previous.slipped, fixed, active, motion, load, table, tuple(force_targets), tuple(jacks), clamps
    )


def _moved_nodes(layout: Layout, fixed: np.ndarray, name: str) -> np.ndarray:
    """Return the nodes (n,) bool that a name of `move` moves: of several nodes, those that are held."""
    selected = nodes_named(layout.net, layout.zones, name)
    held = selected & fixed.any(1)
    return selected if is_node_id(name) or not held.any() else held


def lost_load_warnings(job: Job) -> list[str]:
    """Return a warning if the loads of the last stage differ from [load], which acts in all later states."""
    if not job.stages or not (has_statics(job) or job.dynamics):
        return []
    load = load_settings(job)
    settings = {name: value for stage in job.stages for name, value in stage.set.items()}
    table = next((stage.load_table for stage in reversed(job.stages) if stage.load_table), "none")
    keys = [name for name, value in settings.items() if value != setting_of(load, name)]
    keys += ["load_table"] * (table != "none")
    return [messages.STAGE_LOADS_LOST(name=job.stages[-1].name, keys=", ".join(keys))] if keys else []


def _axes(layout: Layout, named: dict[str, str]) -> np.ndarray:
    """Return the axes (n, 3) bool of the nodes that `release` or `hold` names."""
    selected = np.zeros((layout.net.n, 3), bool)
    for name, axes in named.items():
        rows = nodes_named(layout.net, layout.zones, name)
        selected |= rows[:, None] & [axis in axes for axis in "xyz"]
    return selected


def check_stages(job: Job, model: Model) -> None:
    """Raise InputError for errors in the stages of a job: names, ids, supports, lengths."""
    net, setting = model.net, first_setting(job, model)
    errors: list[str] = []
    for stage in job.stages:
        place = f"{job.path}: [[stage]] {stage.name}"
        errors += _wrong_names(place, stage, model.layout)
        if not errors:
            held_then = _axes(model.layout, axes_by_name(stage.hold))
            for name, axes in axes_by_name(stage.release).items():
                if not (setting.fixed & _axes(model.layout, {name: axes}) & ~held_then).any():
                    text = f"node {name}" if is_node_id(name) else format_value(name)
                    errors.append(messages.RELEASED_FREE_NODES(place=place, name=text))
            setting = next_setting(setting, stage, model.layout)
            errors += _wrong_state(place, stage, setting, model.layout)
        if errors:
            break  # later stages depend on this one
    warm = setting.load.temperature
    for entry in job.combinations:
        name, factor = entry.name, action_factor(entry, "prestress")
        if warm and factor != 1.0:
            errors.append(
                messages.PRESTRESS_FACTOR_AFTER_HEATING(
                    path=job.path, name=name, factor=factor, temperature=warm
                )
            )
        if model.layout.chains and factor != 1.0:
            errors.append(messages.PRESTRESS_FACTOR_WITH_BENDING(path=job.path, name=name, factor=factor))
    free, is_given = ~settlement_axes(net, setting.fixed), parent_ends(net)[:, 0] == np.arange(net.n)
    for name, inputs in model.layout.cases.items():
        settles = np.zeros((net.n, 3)) if inputs.settlement is None else inputs.settlement
        released = net.node_id[((settles != 0.0) & free).any(1) & is_given]
        if len(released):
            nodes = counted("node", released)
            errors.append(messages.RELEASED_SETTLEMENT(path=job.path, name=name, nodes=nodes))
    raise_errors(errors)


def _wrong_names(place: str, stage: Stage, layout: Layout) -> Iterator[str]:
    """Yield errors for names and ids that the net does not have."""
    net = layout.net
    lines = (unknown_name(net, f"{place}: lengths", name) for name in stage.lengths or {})
    yield from filter(None, lines)
    names = [name for name in net.group_names if name]
    for name in stage.active or []:
        if name not in net.group_names:
            yield messages.UNKNOWN_GROUP(
                place=place, name=format_value(name), suggestion=suggest(name, names)
            )
    by_key = {"hold": axes_by_name(stage.hold), "release": axes_by_name(stage.release), "move": stage.move}
    for key, named in by_key.items():
        unknown = [name for name in named or () if not nodes_named(net, layout.zones, name).any()]
        if ids := sorted(int(name) for name in unknown if is_node_id(name)):
            yield messages.UNKNOWN_NODES(place=place, key=key, nodes=format_list(ids))
        for name in [name for name in unknown if not is_node_id(name)]:
            suggestion = suggest(name, ["all", *names, *layout.zones.names])
            yield messages.UNKNOWN_PLACE(place=place, key=key, name=format_value(name), suggestion=suggestion)


def _wrong_state(place: str, stage: Stage, setting: StageSetting, layout: Layout) -> Iterator[str]:
    """Yield errors for moves of free nodes, other moves of one node, cables without length, loose parts."""
    net, is_given = layout.net, parent_ends(layout.net)[:, 0] == np.arange(layout.net.n)
    free = ((setting.moved != 0.0) & ~global_held_axes(net, setting.fixed)).any(1)
    if free.any():
        yield messages.MOVED_FREE_NODES(place=place, nodes=counted("node", net.node_id[free]))
    other = np.zeros(net.n, bool)
    for name, displacement in (stage.move or {}).items():
        other |= _moved_nodes(layout, setting.fixed, name) & (setting.moved != displacement).any(1) & is_given
    if other.any():
        yield messages.MOVED_TWICE(place=place, nodes=counted("node", net.node_id[other]))
    turned = is_guided(net, setting.fixed) & ~is_rotated(net)
    if turned.any():
        yield messages.TURNED_AXES(place=place, nodes=counted("node", net.node_id[turned]))
    is_short = ~(setting.L0 > 0.0)
    if is_short.any():
        elements = counted("element", net.element_id[is_short])
        yield messages.NO_LENGTH_LEFT(place=place, elements=elements)
    is_changed = np.zeros(net.m, bool)
    for name in stage.lengths or {}:
        rows = rows_named(net, name)
        if not setting.active[rows].all():
            yield messages.ABSENT_CABLE(place=place, name=format_value(name))
        if is_changed[rows].any():
            elements = counted("element", net.element_id[rows[is_changed[rows]]])
            yield messages.LENGTH_CHANGED_TWICE(place=place, name=format_value(name), elements=elements)
        is_changed[rows] = True
    is_supported = np.any(setting.fixed | (net.spring > 0), axis=1)
    held = part_contains(connected_parts(net.elements[setting.active], net.n), is_supported)
    is_loose = setting.has_elements(net) & ~held
    if is_loose.any():
        yield messages.UNSUPPORTED_PART(place=place, nodes=counted("node", net.node_id[is_loose]))
