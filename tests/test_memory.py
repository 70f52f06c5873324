"""Results that samples share: every key of a job counts for caches and digests, except those here."""

from dataclasses import fields, replace

import pytest
from conftest import STEEL
from test_study import NODES, with_tables

from netfall.job.cache import WIND_SPEED_KEYS, ResultCache, cache_key
from netfall.job.job import PATH_KEYS, Job
from netfall.job.keys.fields import inner_models, keys_of
from netfall.job.keys.models import Group
from netfall.job.keys.schema import (
    GENERATORS,
    LIST_KEYS,
    LIST_MODELS,
    MODELS,
    SECTIONS,
    ZONE_KEYS,
)
from netfall.job.read import read_job
from netfall.model.layout import make_layout
from netfall.study.file import read_study_plan
from netfall.study.files import InputFiles
from netfall.study.study import SampleQueue

# Two values of each kind that most keys allow; numbers, words and names are tried until two of them fit.
TWO = {
    "flag": (False, True),
    "band": ([1.0, 2.0], [1.0, 3.0]),
    "vector": ([1.0, 2.0, 3.0], [1.0, 2.0, 4.0]),
    "pressure": (-500.0, [0.0, 0.0, -500.0]),
    "points": ([[0.0, 0.0]], [[0.0, 1.0]]),
    "places": ([7], [[1.0, 2.0]]),
    "polygon": ([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], [[0.0, 0.0], [1.0, 0.0], [0.0, 2.0]]),
    "words": (["a"], ["a", "b"]),
    "integers": ([1], [2]),
    "lengths": ({"a": {"change": 1.0}}, {"a": {"force": 1.0}}),
    "shifts": ({"1": [1.0, 2.0, 3.0]}, {"2": [1.0, 2.0, 3.0]}),
    "factors": ({"a": 1.0}, {"a": 2.0}),
    "moves": ({"1": [1.0, 2.0, 3.0]}, {"ring": [1.0, 2.0, 3.0]}),
    "deflection": ("span/200", "span/250"),
    "loads": ({"load.snow": 1.0}, {"load.snow": 2.0}),
}
TRIED = ("a.csv", "b.csv", 1, 2, 8, 16, 0.05, 0.01, 1e-3, 1e-4, 100.0, 200.0, 1e5, 2e5)

# What changes no equilibrium and no model of gusts, with the reason; all other keys must be noticed.
AFTER_REST = {
    "title": "a name",
    "text": "its values stand in the sections; what else stands there is comments",
    "overrides": "their values stand in the sections",
    "zone_rows": "places of values, which stand in the sections",
    "output.frames": "of the dynamic stage",
    "output.history_interval": "of the dynamic stage",
    "output.probes": "of the dynamic stage",
    "output.elements": "of the dynamic stage",
    "output.checkpoint_interval": "of the dynamic stage",
    "modes.count": "each run finds its own",
    "wind.seed": "noise of the gusts, not of their model",
    "wind.ramp": "over which gusts grow in after the rest",
    "removes.elements": "lost after the rest",
    "removes.group": "lost after the rest",
    "removes.cables": "lost after the rest",
    "removes.time": "lost after the rest",
    "removes.duration": "lost after the rest",
}
NO_WIND_YET = dict.fromkeys(WIND_SPEED_KEYS, "the net and its form know no wind")
NOT_ASKED = {
    "path": "the same job elsewhere, with the same files, is the same job",
    "text": "its values stand in the sections; what else stands there is comments",
    "overrides": "their values stand in the sections",
    "zone_rows": "places of values, which stand in the sections",
}


def two_values(key):
    if key.kind == "choice":
        return (*key.choices, "what another version has")[:2]
    values = TWO.get(key.kind) or [value for value in TRIED if key.fits(value)][:2]
    assert all(key.fits(value) for value in values) and values[0] != values[1]
    return values


def values_of(keys):
    """Return a value for each key, of its type."""
    return {key.name: key.checked(two_values(key)[0]) for key in keys}


def dimensions(name, **changed):
    """Return the dimensions of a generator, with other values of some."""
    model = GENERATORS[name]
    return model.model_construct(**values_of(keys_of(model).values()) | changed)


@pytest.fixture
def whole_job(tmp_path):
    """Return a job in which every key of the schema has a value."""
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text("the same\n")
    sections = {name: MODELS[name].model_construct(**values_of(SECTIONS[name])) for name in MODELS}
    for name, keys in ZONE_KEYS.items():
        zone = inner_models(MODELS[name])["zone"].model_construct(**values_of(keys))
        sections[name] = sections[name].replaced(zone={"one": zone})
    sections["net"] = sections["net"].replaced(**{name: dimensions(name) for name in GENERATORS})
    lists = {
        f"{name}s": [LIST_MODELS[name].model_construct(**values_of(keys))] for name, keys in LIST_KEYS.items()
    }
    groups = {"one": Group.model_construct(**values_of(keys_of(Group).values()))}
    return Job(tmp_path / "job.toml", "[net]\n", (), "a roof", groups=groups, **sections, **lists)


def changed(job):
    """Return the job with one change by its name, for each key and for other properties."""
    for name, keys in SECTIONS.items():
        for key in keys if name else ():
            section = getattr(job, name).replaced(**{key.name: two_values(key)[1]})
            yield f"{name}.{key.name}", replace(job, **{name: section})
    for name, keys in ZONE_KEYS.items():
        section = getattr(job, name)
        for key in keys:
            zone = section.zone["one"].replaced(**{key.name: two_values(key)[1]})
            yield f"{name}.zone.one.{key.name}", replace(job, **{name: section.replaced(zone={"one": zone})})
    for name, model in GENERATORS.items():
        for key in keys_of(model).values():
            changed_net = job.net.replaced(**{name: dimensions(name, **{key.name: two_values(key)[1]})})
            yield f"net.{name}.{key.name}", replace(job, net=changed_net)
    for key in keys_of(Group).values():
        group = job.groups["one"].replaced(**{key.name: two_values(key)[1]})
        yield f"groups.one.{key.name}", replace(job, groups={"one": group})
    for name, keys in LIST_KEYS.items():
        for key in keys:
            entry = LIST_MODELS[name].model_construct(**values_of(keys) | {key.name: two_values(key)[1]})
            yield f"{name}s.{key.name}", replace(job, **{f"{name}s": [entry]})
    yield "title", replace(job, title="another")
    yield "text", replace(job, text="[net]  # a comment\n")
    yield "overrides", replace(job, overrides=("wind.speed=30",))
    yield "zone_rows", replace(job, zone_rows=(("one", "b.csv: line 2: zone"),))
    yield "path", replace(job, path=job.path.with_name("other.toml"))


def unnoticed(job, figure):
    """Return the changes of a job that do not change a function of it."""
    return {name for name, other in changed(job) if figure(other) == figure(job)}


def test_every_field_of_a_job_is_varied(whole_job):
    """The test fails for a new section that it does not vary."""
    assert {name.split(".")[0] for name, _ in changed(whole_job)} == {each.name for each in fields(Job)}


def test_all_other_keys_count_for_equilibria_and_wind(whole_job):
    assert unnoticed(whole_job, cache_key) == {*AFTER_REST}


def test_all_other_keys_count_for_the_net_and_its_form(whole_job):
    figure = lambda job: cache_key(job, without=WIND_SPEED_KEYS)
    assert unnoticed(whole_job, figure) == {*AFTER_REST, *NO_WIND_YET}


def test_all_other_keys_count_for_the_digest_of_checkpoints_and_studies(whole_job):
    assert unnoticed(whole_job, Job.digest) == {*NOT_ASKED}


def test_the_existence_of_a_removal_counts(whole_job):
    """The dynamic stage then begins in equilibrium under all loads, which is one more equilibrium."""
    assert cache_key(replace(whole_job, removes=[])) != cache_key(whole_job)


def test_an_override_of_the_net_counts(whole_job):
    """A partition of the job's net then does not apply."""
    assert cache_key(replace(whole_job, overrides=("net.saddle.cells=4",))) != cache_key(whole_job)


@pytest.mark.parametrize("section, name", PATH_KEYS)
def test_the_content_of_a_file_is_part_of_the_key_of_a_result(whole_job, section, name):
    """For each key that is a path: the same file name with other bytes gives another result."""
    alone = whole_job
    for place, key in PATH_KEYS:
        path = "b.csv" if (place, key) == (section, name) else None
        alone = replace(alone, **{place: getattr(alone, place).replaced(**{key: path})})
    before = cache_key(alone), alone.digest()
    (alone.path.parent / "b.csv").write_text("something else\n")
    after = replace(alone)  # the next job is read again
    assert before[0] != cache_key(after) and before[1] != after.digest()


def test_all_paths_are_known(whole_job):
    """Each key that names a file has the kind that digests follow, also in entries of lists."""
    named = {(name, key.name) for name, keys in SECTIONS.items() for key in keys if "path of" in key.meaning}
    assert named == set(PATH_KEYS)
    in_lists = {
        f"{name}s.{key.name}" for name, keys in LIST_KEYS.items() for key in keys if key.kind == "path"
    }
    assert not in_lists & unnoticed(whole_job, Job.files)
    assert all(key.kind == "path" for keys in LIST_KEYS.values() for key in keys if "path of" in key.meaning)
    for keys in ZONE_KEYS.values():
        assert not [key.name for key in keys if key.kind == "path" or "path of" in key.meaning]


def test_a_changed_table_makes_a_new_net(workshop):
    """Two runs of one process: the table changes in between, and node 2 has its new position."""
    job, _ = with_tables(workshop)
    memory = ResultCache(4)
    assert make_layout(read_job(job), 1, memory).net.x[1].tolist() == [1.0, 1.0, 0.0]
    again = make_layout(read_job(job), 1, memory)
    assert again.net is make_layout(read_job(job), 1, memory).net  # it is remembered
    (workshop.folder / "nodes.csv").write_text(NODES.replace("2,1,1,0,0", "2,1,1,0.5,0"))
    assert make_layout(read_job(job), 1, memory).net.x[1].tolist() == [1.0, 1.0, 0.5]


def plan_of(workshop, study: str):
    path = workshop.folder / "study.toml"
    path.write_text(study)
    return read_study_plan(path)


def test_samples_are_batched_by_shared_results(workshop):
    """Seeds and history rows share an equilibrium. Damping ratios do not, although they could."""
    wind = "speed = 20.0\npressure_coefficient = 1.0\nturbulence_intensity = 0.2\nbase_height = 0.0\n"
    job = f"{STEEL}[wind]\n{wind}[dynamics]\nduration = 1.0\n"
    workshop.job(job, NODES, "start,end\n1,2\n2,3\n3,1\n")
    vary = '"dynamics.mass_damping" = [0.1, 0.2]\n"output.history_interval" = [0.01, 0.02]\n'
    vary += '"wind.seed" = [1, 2]\n'
    plan = plan_of(workshop, 'job = "job.toml"\n[vary]\n' + vary)
    queue, last, batches = SampleQueue(plan, [*range(len(plan))]), None, {}
    while task := queue.take(last):
        last = task[0]
        batches.setdefault(last, []).append(plan.sample(task[1]).values["dynamics.mass_damping"])
    assert sorted(batches.values()) == [[0.1] * 4, [0.2] * 4]


def test_every_file_of_all_samples_is_in_the_digest(workshop):
    """The sixtieth of 120 winds, which is not among the first and last values, changes the digest."""
    with_tables(workshop)
    names = ["wind.csv", *(f"wind-{k}.csv" for k in range(120))]
    for name in names[1:]:
        (workshop.folder / name).write_text("time,speed\n0,20\n1,20\n")
    plan = plan_of(workshop, f'job = "job.toml"\n[vary]\n"wind.file" = {names[1:]!r}\n')
    assert {path.name for path in plan.files} == {"job.toml", "nodes.csv", "elements.csv", *names}
    before = InputFiles(plan.files).digest
    (workshop.folder / "wind-60.csv").write_text("time,speed\n0,20\n1,21\n")
    assert InputFiles(plan.files).digest != before
