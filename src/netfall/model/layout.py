"""Layout of a job: its net as given, before form finding, and its probes; on rank 0, in global order."""

import hashlib
from dataclasses import dataclass, fields, replace
from typing import Any, final

import numpy as np

from netfall.core.errors import InputError, raise_errors
from netfall.geometry import messages as geometry_messages
from netfall.geometry.areas import RoofFaces, find_roof
from netfall.geometry.build import build_net
from netfall.geometry.cables import NO_BENDING, BendingChains, find_bending_chains
from netfall.geometry.net import Net
from netfall.geometry.sections import given_cable_keys
from netfall.geometry.slip_points import SlidingCables, find_sliding_cables, keep_cables_on_one_rank
from netfall.geometry.turned import global_held_axes, is_rotated
from netfall.geometry.zones import Zones, make_zones
from netfall.job import derived
from netfall.job.cache import NO_CACHE, WIND_SPEED_KEYS, ResultCache, cache_key
from netfall.job.job import Job
from netfall.job.values import format_list
from netfall.loads.cases import CaseInputs, read_case_inputs
from netfall.loads.loads import GivenLoads, coefficients_of, read_given_loads
from netfall.loads.removal import find_removed_elements
from netfall.loads.wind.field import read_history
from netfall.loads.wind.measured import TableHistory
from netfall.loads.wind.sectors import Sectors, read_sectors
from netfall.model import messages
from netfall.model.start import load_notes, point_notes, table_notes, unit_notes, weight_notes
from netfall.model.unused import unused_zone_notes, without_effect
from netfall.parallel import partition
from netfall.physics.fields import Features
from netfall.physics.law.branches import band_branches


@dataclass(frozen=True)
class Probes:
    """Nodes and elements whose histories are recorded, in global numbers.

    particles : displacements; elements : axial forces of the elements that meet the particles
    named : (k,) elements by id, axial forces; named_id : (k,) their ids
    """

    particles: np.ndarray
    elements: np.ndarray
    named: np.ndarray
    named_id: np.ndarray


def find_probes(job: Job, net: Net) -> Probes:
    """Find the nodes and elements that [output] names. Raises InputError for an unknown id."""
    probes, element_ids = job.output.probes, job.output.elements or []
    errors = []
    for key, noun, requested, ids in (
        ("probes", "node", [probe for probe in probes if isinstance(probe, int)], net.node_id),
        ("elements", "element", element_ids, net.element_id),
    ):
        if unknown := sorted(set(requested) - set(ids.tolist())):
            first, last, named = ids.min(), ids.max(), format_list(unknown)
            errors.append(
                messages.UNKNOWN_OUTPUT_IDS(
                    path=job.path, key=key, kind=noun, first=first, last=last, ids=named
                )
            )
    raise_errors(errors)
    particles = np.array([_particle(net, probe) for probe in probes], np.int64)
    rows = [np.flatnonzero(net.element_id == number) for number in dict.fromkeys(element_ids)]
    named_rows = np.concatenate([np.zeros(0, np.int64), *rows])
    adjacent = np.flatnonzero(np.isin(net.elements, particles).any(1))
    return Probes(particles, adjacent, named_rows, net.element_id[named_rows])


def _particle(net: Net, probe: int | list[float]) -> int:
    """Return the node with an id, or the node nearest to a point: [x, y] in plan, [x, y, z] in space."""
    if isinstance(probe, int):
        return int(np.flatnonzero(net.node_id == probe)[0])
    return int(np.argmin(np.sum((net.x[:, : len(probe)] - np.array(probe)) ** 2, axis=1)))


@final
@dataclass(frozen=True)
class Layout:
    """The whole net as given, before form finding, on rank 0.

    part : (n,) rank of each particle; partition_source : origin of the partition
    lost : rows of the elements that each [[remove]] names
    slides : sliding cables, None: none
    pressure_coefficient : (n,) net pressure coefficient of the wind, None: no wind; sectors : its table
    measured : wind from a file, None: the wind is generated or absent
    loads : of nodes and elements in all states; load_tables : loads of each table of loads, by path
    cases : inputs of each [[case]], by name; chains : bending chains, None: none
    notes : messages on unusual values of the net, its tables and its roof
    """

    net: Net
    roofing: RoofFaces
    zones: Zones
    part: np.ndarray
    partition_source: str
    lost: list[np.ndarray]
    probes: Probes
    slides: SlidingCables | None
    pressure_coefficient: np.ndarray | None
    sectors: Sectors | None
    measured: TableHistory | None
    loads: GivenLoads
    load_tables: dict[str, GivenLoads]
    cases: dict[str, CaseInputs]
    chains: BendingChains | None
    notes: tuple[str, ...]


def make_layout(job: Job, ranks: int, cache: ResultCache = NO_CACHE) -> Layout:
    """Build the net, roof, zones and partition of a job. Raises InputError."""
    key = ranks, cache_key(job, without=WIND_SPEED_KEYS)
    net, roofing, zones, part, source = cache.get_or_compute("net", key, lambda: _partition_net(job, ranks))
    if chains := find_bending_chains(net):
        net = replace(net, bending=(chains.at != NO_BENDING).any(1))  # other bars buckle as hinged ones
    lost, probes = find_removed_elements(job, net), find_probes(job, net)
    loads, load_tables, load_table_notes = read_given_loads(job, net)
    loaded = np.any([each.nodes.any(1) for each in (loads, *load_tables.values())], axis=0)
    slides, errors = find_sliding_cables(job, net, zones, loaded)
    if job.slides and job.dynamics and job.dynamics.axial_damping_ratio:
        errors.append(messages.DAMPING_WITH_SLIDE(path=job.path))
    raise_errors(errors)
    sectors = read_sectors(job, zones.names)
    coefficient = coefficients_of(job.wind, sectors, zones) if job.wind else None
    cases, case_notes = read_case_inputs(
        job, net, zones, bool(loads.nodes.any() or loads.elements is not None)
    )
    notes = [*net.notes, *roofing.notes, *zones.notes, *without_effect(job, net)]
    notes += sectors.notes if sectors else []
    if places := derived.winds_beside_roof(job) if roofing.given.surface.any() else []:
        notes.append(messages.NO_WIND_ON_ROOF(places=", ".join(places), area=roofing.given.surface.sum()))
    notes += unused_zone_notes(job, zones, [sectors, *(c.sectors for c in cases.values())])
    notes += [*case_notes, *unit_notes(net), *load_notes(job), *weight_notes(job, net, loads.nodes)]
    notes += load_table_notes
    notes += [geometry_messages.NO_BENDING_CHAIN()] if chains and not len(chains.particles) else []
    measured = read_history(job)
    if measured:
        kind = "taps" if job.wind.taps else "points"
        axes = len(derived.tap_axes(job)) if job.wind.taps else 2
        notes += [*measured.notes, *point_notes(f"[wind] {kind}", kind, net, measured.places, axes)]
    notes += table_notes(job, coefficient, measured, cases)
    for name, case in cases.items():
        axes = 2 if case.points is None else case.points.shape[1]
        notes += point_notes(f"[[case]] {name}: pressure_table", "points", net, case.points, axes)
    part, all_notes = keep_cables_on_one_rank(part, slides, net), tuple(dict.fromkeys(notes))
    return Layout(
        net,
        roofing,
        zones,
        part,
        source,
        lost,
        probes,
        slides,
        coefficient,
        sectors,
        measured,
        loads,
        load_tables,
        cases,
        chains,
        all_notes,
    )


def _partition_net(job: Job, ranks: int) -> tuple[Any, ...]:
    """Return the net, roofing, zones, partition and the origin of the partition."""
    net = build_net(job)
    try:
        roofing = find_roof(job, net)
        zones = make_zones(job, net, roofing)
    except InputError as error:
        raise InputError([*net.notes, *error.lines]) from None
    if not job.changes_net():
        part = partition.read_partition(job.name, net.n, net.elements, ranks)
        if part is not None:
            return net, roofing, zones, part, f"{partition.FOLDER / job.name}.graph.part.{ranks}"
    return net, roofing, zones, partition.metis_partition(net.n, net.elements, ranks), "METIS, k-way"


def layout_digest(job: Job, net: Net) -> str:
    """Compute a digest of a job, the files that it reads and every column of its net."""
    total = hashlib.sha256(job.digest().encode())
    for column in fields(Net):
        values = getattr(net, column.name)
        if column.name != "notes" and values is not None:
            total.update(column.name.encode())
            total.update(values.tobytes() if isinstance(values, np.ndarray) else repr(values).encode())
    return total.hexdigest()


def damping_branches(job: Job) -> tuple[float, ...]:
    """Return the Maxwell branches of the constant damping ratio in a band; empty without it."""
    dynamics = job.dynamics
    if not (dynamics and dynamics.axial_damping_ratio):
        return ()
    return band_branches(dynamics.axial_damping_ratio, *dynamics.axial_damping_band)


def make_features(job: Job, net: Net, slides: SlidingCables | None) -> Features:
    """Return the features for which the kernels are compiled."""

    def differ(values: Any) -> bool:
        return bool((values != values[:1]).any())

    held, breaks = global_held_axes(net, net.fixed), bool(np.isfinite(net.fracture_strain).any())
    detaches = job.dynamics is not None and (breaks or bool(job.removes))
    strength = np.where(net.bar, np.inf, net.EA * net.fracture_strain)
    breaks_first = bool((np.isfinite(net.yield_force) & (net.yield_force > strength)).any())
    return Features(
        fragments=not job.dynamics or job.dynamics.fragments,
        plastic=bool(np.isfinite(net.yield_stress).any()),
        fracture=breaks,
        detaches=detaches,
        iced=breaks and bool(job.load and job.load.ice) and net.diameter is not None,
        drags=detaches and derived.has_fragment_drag(job),
        steady_drag=detaches and derived.has_fragment_drag(job) and job.wind.pressures is not None,
        wind=job.wind is not None,
        air=derived.has_aerodynamic_damping(job),
        motion=derived.moves_supports(job),
        slip=bool(job.slides),
        sliding=int(slides.column.max()) + 1 if slides and job.dynamics else 0,
        air_mass=derived.has_added_air_mass(job),
        band=damping_branches(job),
        tapped=job.wind is not None and job.wind.pressures is not None,
        varying=derived.has_varying_forces(job),
        springs=bool(net.spring.any()),
        turned=bool(is_rotated(net).any()),
        losses=bool(job.removes),
        strain=job.cable.strain_measure,
        cable=given_cable_keys(job),
        bars=bool(net.bar.any()),
        bending=net.bending is not None,
        buckling=net.buckling is not None,
        part_held=bool((held.any(1) & ~held.all(1)).any()),
        sections=differ(net.EA) or differ(net.yield_force) or breaks_first,
        strengths=differ(net.fracture_strain),
        energy=job.output.energy,
        shaken=derived.is_shaken(job),
    )
