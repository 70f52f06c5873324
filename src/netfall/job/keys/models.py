"""Sections of a job file: type, unit, range, default and meaning of each key.

A new key is a new field here. `fields` explains how messages and pages are made from the fields.
"""

from copy import copy
from typing import Annotated, Any, Literal, get_type_hints

from pydantic import Field, create_model

from netfall.job.keys.fields import (
    MAX_INT64,
    Band,
    Decay,
    Deflection,
    Ids,
    Places,
    Points,
    Pressure,
    Section,
    TablePath,
    Text,
    Title,
    Vector,
    Words,
    ZonedSection,
    key,
)

# [1/K] coefficients of thermal expansion. Within them no [load] temperature leaves an element without length.
MIN_EXPANSION, MAX_EXPANSION = -5e-4, 1e-3


class Top(Section):
    """Keys outside of sections."""

    title: Title = key("title of the job", "")


class Cable(Section):
    """Properties of the elements; groups override most of them."""

    kind: Literal["cable", "bar"] = key("cable: tension only; bar: tension and compression", "cable")
    modulus: float | None = key(
        "Young's modulus; with area, or axial_stiffness instead", unit="Pa", ge=1.0, le=1e15
    )
    area: float | None = key("cross-section", unit="m2", ge=1e-12, le=10000)
    density: float | None = key(
        "mass density; with area, or mass_per_length instead", unit="kg/m3", ge=0.001, le=1e6
    )
    axial_stiffness: float | None = key("EA, instead of modulus and area", unit="N", ge=1.0, le=1e15)
    mass_per_length: float | None = key(
        "mass per length, instead of density and area", unit="kg/m", ge=1e-9, le=1e7
    )
    catalogue: TablePath | None = key("path of a table of types, relative to the job file")
    type: Text | None = key("name of a row of the catalogue, for stiffness, mass and breaking load")
    prestress: float = key("axial force for form finding, tension positive", 0.0, unit="N", ge=-1e12, le=1e12)
    horizontal_force: float | None = key(
        "horizontal component of the tension for form finding by force density, instead of prestress: the "
        "force density of each element is this force over its length in plan",
        unit="N",
        gt=0.0,
        le=1e12,
    )
    yield_stress: float | None = key("yield stress; absent: elastic", unit="Pa", gt=0.0, le=1e20)
    fracture_strain: float | None = key(
        "total strain at fracture; absent: no fracture by strain", gt=0.0, le=1e6
    )
    breaking_load: float | None = key(
        "breaking force; absent: no fracture by force", unit="N", gt=0.0, le=1e20
    )
    strength_cov: float = key("coefficient of variation of the strength among cables", 0.0, ge=0.0, le=0.5)
    length_std: float = key(
        "standard deviation of the unstressed length of each cable", 0.0, unit="m", ge=0.0, le=10.0
    )
    length_seed: int = key("seed of the random length errors", 1, ge=0, le=MAX_INT64)
    strength_seed: int = key("seed of the random strengths", 1, ge=0, le=MAX_INT64)
    second_moment: float | None = key(
        "second moment of area of a bar, about its weaker axis, for the Euler load and bending",
        unit="m4",
        gt=0.0,
        le=10000,
    )
    buckling_length: float | None = key(
        "buckling length of a bar, for the Euler load; absent: length of the element in the table",
        unit="m",
        gt=0.0,
        le=100000,
    )
    bending: bool = key("whether chains of bars resist bending, with second_moment", False)
    buckling: bool = key(
        "whether bars carry at most the Euler load in compression, and also break in compression", False
    )
    buckling_curve: Literal["a0", "a", "b", "c", "d"] = key(
        "buckling curve of EN 1993-1-1, 6.3.1.2, for the check of compressed bars", "c"
    )
    section_modulus: float | None = key(
        "section modulus of a bar, second_moment over the distance of the outermost fibre (in a box the "
        "corner), for the check of axial force with bending in the report; absent: no such check",
        unit="m3",
        gt=0.0,
        le=10000,
    )
    design_strength: float | None = key(
        "design strength, used only in the check of axial force with bending, not for yielding; a smaller "
        "yield_stress takes precedence",
        unit="Pa",
        gt=0.0,
        le=1e20,
    )
    thermal_expansion: float = key(
        "coefficient of thermal expansion", 12e-6, unit="1/K", ge=MIN_EXPANSION, le=MAX_EXPANSION
    )
    diameter: float | None = key(
        "diameter for wind across the axis and for ice; absent: neither acts", unit="m", gt=0.0, le=100.0
    )
    drag_coefficient: float = key("drag coefficient c_d of elements with a diameter", 1.2, ge=0.0, le=10.0)
    strain_measure: Literal["engineering", "logarithmic"] = key("strain measure", "engineering")


def shared_key(model: type[Section], name: str, default: Any = None) -> Any:
    """Return the field of a key that another section has too, with another default."""
    field = copy(model.model_fields[name])
    field.default = default
    return field


def _group_model(without: tuple[str, ...]) -> type[Section]:
    """Return the model of the keys of [cable] that a group can override, each without a default."""
    hints = get_type_hints(Cable, include_extras=True)
    names = [name for name in Cable.model_fields if name not in without]
    fields: dict[str, Any] = {name: (hints[name] | None, shared_key(Cable, name)) for name in names}
    return create_model("Group", __base__=Section, __doc__="Properties of a group of elements.", **fields)


# Keys that groups cannot override.
GLOBAL_CABLE_KEYS = ("strain_measure", "catalogue", "strength_seed", "length_seed")
Group: type[Section] = _group_model(GLOBAL_CABLE_KEYS)


class FormFinding(Section):
    """Form finding before all other stages."""

    method: Literal["fpm", "force_density", "given_geometry"] = key(
        "fpm: equilibrium of the given prestresses, for nets of known forces, also with masts and rings; "
        "force_density: linear force density method, for cable nets between supports, also with "
        "horizontal_force; given_geometry: nodes stay, and the self-stress nearest to the prestress acts, "
        "equal within a group, for wheels, domes and built roofs",
        "fpm",
    )
    loads: Literal["none", "permanent"] = key(
        "load of the form-found geometry; permanent: self weight and dead load", "none"
    )
    start: Literal["given", "force_density"] = key(
        "fpm: start from the given geometry, or from that of the force density method", "given"
    )
    modulus_factor: float = key(
        "fpm: factor on the modulus during form finding; 0: constant tension", 0.001, ge=0.0, le=1.0
    )
    tolerance: float = key(
        "largest residual force, as a share of the largest prestress of the elements that can move",
        1e-6,
        ge=1e-12,
        le=0.1,
    )
    max_iterations: int = key("fpm: largest number of iterations, if the form needs relaxation", 200000, ge=1)


class LoadZone(Section):
    """Values of [load.zone.NAME] that differ from those of [load]."""

    dead: float | None = key(
        "weight of the roof's cladding, downward; its mass moves with the particles",
        unit="N/m2",
        ge=0.0,
        le=1e9,
    )
    snow: float | None = key(
        "snow load on the area in plan, downward; its mass moves with the particles",
        unit="N/m2",
        ge=0.0,
        le=1e9,
    )
    pressure: Pressure | None = key(
        "static load of the roof: positive presses on it, against the upward normal, negative lifts; or "
        "[x, y, z]",
        unit="N/m2",
    )
    added_mass: float | None = key(
        "added mass of the air: inertia without weight, without `mass_damping`",
        unit="kg/m2",
        ge=0.0,
        le=1e6,
    )


class Load(ZonedSection):
    """Static loads, and the search for their equilibria."""

    self_weight: bool = key("weight of the elements", True)
    dead: float = shared_key(LoadZone, "dead", 0.0)
    snow: float = shared_key(LoadZone, "snow", 0.0)
    pressure: Pressure | None = shared_key(LoadZone, "pressure")
    ice: float = key(
        "radial thickness of the ice on elements with a diameter: adds weight, mass and area for the wind",
        0.0,
        unit="m",
        ge=0.0,
        le=10.0,
    )
    added_mass: float = shared_key(LoadZone, "added_mass", 0.0)
    load_table: TablePath | None = key(
        "path of a table of loads of nodes (node, load_x, ...), elements (element, line_x, ...) or zones "
        "(zone, snow, ...)"
    )
    temperature: float = key(
        "change of temperature of all elements since form finding", 0.0, unit="K", ge=-273.0, le=1000.0
    )
    stop_at_strength: bool = key(
        "whether a static state with an exceeded strength counts as no equilibrium; false: the "
        "exceeded strength is reported",
        False,
    )
    steps: int | None = key(
        "load steps of the static analysis; 0: none; absent: 1 if there are neither [dynamics] nor cases "
        "nor combinations, otherwise 0",
        ge=0,
        le=100000,
    )
    ramp: float = key(
        "time over which the pressure grows from zero in the dynamic stage, without load steps; 0: at once",
        0.0,
        unit="s",
        ge=0.0,
        le=1e9,
    )
    tolerance: float = key(
        "largest estimated error of an equilibrium, as a share of the largest displacement and tension",
        1e-6,
        ge=1e-12,
        le=0.1,
    )
    max_iterations: int = key(
        "largest number of iterations if an equilibrium needs dynamic relaxation", 500000, ge=1
    )
    zone: dict[str, LoadZone] = Field(default={}, description="values of zones, by name")


class Roof(Section):
    """Surface that carries loads and wind."""

    groups: Words | None = key("groups of elements whose faces carry loads and wind; absent: all")
    openings: Points = key("x, y of a point in each face that is an opening", [], unit="m")
    lines: TablePath | None = key(
        "path of a table start, end: ids of nodes between which a face has an edge without an element"
    )
    faces: TablePath | None = key("path of a table of the faces; absent: faces of the net in plan")
    normal: Vector | None = key(
        "outward direction, for facades: faces are found and drawn as seen from there, "
        "and their normals point there; absent: [0, 0, 1], upward"
    )


class WindZone(Section):
    """Values of [wind.zone.NAME] that differ from those of [wind]."""

    pressure_coefficient: float | None = key(
        "net pressure coefficient c_p,net: positive presses on the roof, against the upward normal; "
        "negative is suction, which lifts",
        ge=-10000,
        le=10000,
    )
    aerodynamic_damping: float | None = key(
        "aerodynamic damping coefficient kappa: pressure kappa rho U v against the velocity v along "
        "the normal; half the slope of the normal force coefficient; 1: attached flow; 0: none",
        ge=0.0,
        le=10.0,
    )


class Wind(ZonedSection):
    """Wind of the dynamic stage."""

    speed: float | None = key("U0, mean wind speed at 10 m above ground", unit="m/s", ge=0.1, le=200.0)
    file: TablePath | None = key("path of a table time, speed, instead of a generated wind")
    points: TablePath | None = key(
        "path of a table name, x, y, z: points at which the speeds of file were measured"
    )
    pressures: TablePath | None = key(
        "path of a table of pressures at taps over time, instead of a wind speed", unit="N/m2"
    )
    taps: TablePath | None = key("path of a table name, x, y: positions of the taps")
    direction: float = key(
        "direction that the wind blows to, from x towards y: 30 is a wind from 210",
        0.0,
        unit="degrees",
        ge=-360.0,
        le=360.0,
    )
    surface_drag: float | None = key(
        "Davenport's surface drag coefficient k, instead of turbulence_intensity: the variance of the "
        "gusts is 6 k U0^2; 0: no gusts",
        ge=0.0,
        le=0.2,
    )
    turbulence_intensity: float | None = key(
        "turbulence intensity I at 10 m; a generated wind needs it or surface_drag (k = I^2 / 6); 0: no "
        "gusts",
        ge=0.0,
        le=1.0,
    )
    spectrum: Literal["davenport", "kaimal", "von_karman", "en1991"] = key(
        "spectrum of the gusts along the wind", "davenport"
    )
    gust_length: Annotated[float, Field(ge=0.1, le=100000)] | Literal["auto"] = key(
        "L of the spectrum at 10 m; auto: 1200 (davenport), 56.7 (kaimal), 63.2 (von_karman, en1991)",
        "auto",
        unit="m",
    )
    pressure_coefficient: float | None = shared_key(WindZone, "pressure_coefficient")
    sectors: TablePath | None = key(
        "path of a table of coefficients by direction, with a column for each zone, instead of "
        "pressure_coefficient"
    )
    air_density: float = key("density of the air", 1.25, unit="kg/m3", gt=0.0, le=10000)
    aerodynamic_damping: float = shared_key(WindZone, "aerodynamic_damping", 0.0)
    time_step: float = key("time step of the generated histories", 0.05, unit="s", ge=0.0001, le=60.0)
    ar_order: int = key("largest number of lags of the autoregressive model of the gusts", 14, ge=1, le=30)
    seed: int = key("seed of the gusts: the same seed gives the same gusts", 1, ge=0, le=MAX_INT64)
    control_points: int = key("largest number of points at which histories are generated", 25, ge=1, le=400)
    gust_field: Literal["point", "area_mean"] = key(
        "gusts at the control points; area_mean: means over the loaded surface around them; point: "
        "values at the points, equally strong at every node",
        "area_mean",
    )
    coherence_decay: Decay = key(
        "decay C of Davenport's coherence along the wind, across it and vertically", [8.0, 16.0, 10.0]
    )
    profile_exponent: float = key(
        "exponent of the power law of the mean speed over height", 0.16, ge=0.0, le=1.0
    )
    base_height: float = key(
        "height of z = 0 above ground; it must be given for a wind of speeds with profile_exponent > 0",
        10.0,
        unit="m",
        ge=-1e6,
        le=1e6,
    )
    onset: Literal["static", "sudden"] = key(
        "static: the stage starts in equilibrium under the mean wind, then gusts grow; sudden: the "
        "whole wind acts at t = 0",
        "static",
    )
    ramp: float = key(
        "time over which the gusts grow after a static onset; 0: at once", 2.0, unit="s", ge=0.0, le=1e9
    )
    after_fracture: Literal["detached", "particle", "panels", "all", "none"] = key(
        "parts that lose the wind after a fracture; particle: the node of the broken element; detached: "
        "this node, and parts that no unbroken elements join to a vertical support, on which drag acts; "
        "panels: the torn faces, with their loads and masses; all: the whole roof; none: nothing",
        "detached",
    )
    zone: dict[str, WindZone] = Field(default={}, description="values of zones, by name")


class CaseWind(Wind):
    """Static wind of a case."""

    pressure_factor: float = key("factor on the pressure of a static wind", 1.0, ge=-100.0, le=100.0)


class Dynamics(Section):
    """Dynamic stage."""

    duration: float = key("simulated time", ..., unit="s", gt=0.0, le=1e9)
    time_step: Annotated[float, Field(gt=0.0, le=1e9)] | Literal["auto"] = key(
        "time step of the dynamic stage; auto: from the stable step of the net", "auto", unit="s"
    )
    safety: float = key('share of the stable step that time_step = "auto" takes', 0.8, gt=0.0, le=1.0)
    mass_damping: float = key("mass-proportional damping zeta", 0.0, unit="1/s", ge=0.0, le=1e9)
    axial_damping_ratio: float | None = key(
        "damping ratio of axial strain, constant over axial_damping_band", gt=0.0, le=0.2
    )
    axial_damping_band: Band | None = key("frequency band of axial_damping_ratio", unit="Hz")
    fragment_mass: float = key(
        "largest share of the dead load and `mass` of a node that a fragment takes to allow a longer step;"
        " 0: half of the element only, as in the paper",
        0.05,
        ge=0.0,
        le=0.5,
    )
    fragments: bool = key(
        "whether a particle separates where an element breaks, as in the paper; false: the element is"
        " removed, and its mass stays at its ends",
        True,
    )
    mass_scaling: float = key(
        "largest share of the moving mass that is added as inertia at the stiffest elements, for a "
        "longer step; with fracture only if fragments = false",
        0.0,
        ge=0.0,
        le=1.0,
    )


class GroupLimits(Section):
    """Limits of [limits.group.NAME] that differ from those of [limits]."""

    displacement: Deflection | None = key(
        "largest displacement of a node in SLS combinations, or a share of the span; absent: no limit",
        unit="m",
    )
    span: float | None = key('span that displacement = "span/250" refers to', unit="m", gt=0.0, le=1e6)


class Limits(GroupLimits):
    """Limits of serviceability."""

    reference: Literal["permanent", "form"] = key(
        "reference of the displacements; permanent: the equilibrium under self weight and dead load; "
        "form: the form-found geometry, or that after the last stage of erection",
        "permanent",
        name="from",
    )
    slack: int | None = key(
        "largest number of slack cables in SLS combinations; absent: no limit", ge=0, le=1000000000
    )
    group: dict[str, GroupLimits] = Field(
        default={}, description="limits for the nodes of a group's elements, by name or pattern"
    )


class Output(Section):
    """Datasets that a run writes."""

    frames: int = key("number of snapshots over the duration", 120, ge=1, le=1000000)
    history_interval: float = key("time between rows of /history", 0.01, unit="s", gt=0.0, le=1e9)
    energy: bool = key(
        "energy check; false saves its cost, and works and errors of /history are nan",
        True,
    )
    probes: Places = key("nodes with histories: [x, y], [x, y, z] or ids", [], unit="m")
    elements: Ids | None = key("ids of elements with histories of their axial force")
    checkpoint_interval: float = key(
        "simulated time between checkpoints; 0: none", 0.0, unit="s", ge=0.0, le=1e9
    )


class Modes(Section):
    """Natural modes where the dynamic stage begins."""

    count: int = key(
        "number of natural modes where the dynamic stage begins, lowest first; 0: none",
        10,
        ge=0,
        le=1000,
    )
