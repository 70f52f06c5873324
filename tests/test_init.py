"""Where people begin: `netfall init`, and the examples in --help."""

import shlex
import tomllib

import pytest

from netfall.errors import InputError
from netfall.examples import EXAMPLES
from netfall.job.read import read_job
from netfall.job.schema import LISTS, SECTIONS
from netfall.job.template import write_template
from netfall.parser import parser
from netfall.solve.check import check_job


def test_the_first_job_is_valid_and_names_every_key(tmp_path):
    """It passes the check as it stands; each key is there, and a section that is uncommented is read."""
    path = tmp_path / "roof.toml"
    write_template(path)
    said = []
    check_job(read_job(path), said.append)
    assert any(line.startswith("stages: form finding") for line in said)
    text = path.read_text()
    for section, keys in (SECTIONS | LISTS).items():
        place = f"[[{section}]]" if section in LISTS else f"[{section}]"
        part = text.split(f"{place}\n")[-1].split("\n\n")[0] if section else text
        assert [key.name for key in keys if f"{key.name} =" not in part] == [], section
    dynamics = text.split("# [dynamics]\n")[1].split("\n\n")[0]
    given = [line.removeprefix("# ") for line in dynamics.splitlines() if "(absent)" not in line]
    assert tomllib.loads("\n".join(given))["duration"] == 6.0
    path.write_text(text.replace("# [dynamics]\n" + dynamics, "[dynamics]\n" + "\n".join(given)))
    assert read_job(path).dynamics.safety == 0.8  # all defaults, written out, are right
    with pytest.raises(InputError, match="is there already"):
        write_template(path)


@pytest.mark.parametrize("verb", EXAMPLES)
def test_examples_are_commands_that_the_program_takes(verb):
    """Each example of --help is read without an error, and stands in the help."""
    top = parser()
    for example in EXAMPLES[verb]:
        words = shlex.split(example)
        asked = top.parse_args(words[words.index("netfall") + 1 :])
        assert asked.verb == verb
        shown = next(action for action in top._actions if action.dest == "verb").choices[verb].format_help()
        assert f"  {example}\n" in shown
