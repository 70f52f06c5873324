"""The list of deliberate faults (faults.py) matches the program."""

import ast

import pytest
from conftest import ROOT
from faults import read_faults

FAULTS = read_faults()


@pytest.mark.parametrize("fault", FAULTS, ids=[fault.name for fault in FAULTS])
def test_every_fault_still_applies(fault):
    """Its old text occurs once in its file, and the new text is other valid Python."""
    made = ast.parse(fault.edited(ROOT / "src"))
    assert ast.dump(made) != ast.dump(ast.parse((ROOT / "src" / "netfall" / fault.file).read_text()))


def test_every_test_of_a_quick_set_exists():
    """Each file and name occurs; ids of cases are not checked."""
    for test in sorted({test for fault in FAULTS for test in fault.tests}):
        file, _, name = test.partition("::")
        text = (ROOT / "tests" / file).read_text()
        assert f"def {name.partition('[')[0]}(" in text if name else text, test


def test_faults_are_spread_over_the_program():
    """Forty with different names, from every part that computes or prints."""
    assert len(FAULTS) == 40 and len({fault.name for fault in FAULTS}) == len(FAULTS)
    assert {fault.file.partition("/")[0] for fault in FAULTS} >= {
        *("physics", "explicit", "driver", "loads", "geometry", "parallel", "results", "statics", "study")
    }
