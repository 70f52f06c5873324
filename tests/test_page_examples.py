"""The code blocks of the pages run and print the shown output."""

import page_examples
import pytest
from page_examples import BlockError, matches, renew, run_page

PAGE = """\
# A page

```toml title="folder/a.toml"
x = 1
```

1. Indented:

   ```console
   $ cat folder/a.toml
   x = 2
   $ printf 'first\\nin 3 s\\nlast\\n'
   first
   in ... s
   ...
   $ false  # exit 1
   ```

```sh
exit 3
```
"""


LONGEST_FIRST = sorted(page_examples.PAGES, key=lambda page: "tutorials" not in page.parts)


@pytest.mark.parametrize(
    "page", LONGEST_FIRST, ids=lambda page: page.relative_to(page_examples.ROOT).as_posix()
)
def test_blocks_of_a_page_run(page, tmp_path):
    faults = run_page(page, tmp_path)
    assert not faults, "\n".join(faults)


def test_changed_output_is_an_error_and_can_be_renewed(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    (fault,) = run_page(page, tmp_path)
    assert "cat folder/a.toml" in fault and "+x = 1" in fault
    (tmp_path / "jobs").unlink()
    assert run_page(page, tmp_path, write=True) == []
    assert page.read_text() == PAGE.replace("x = 2", "x = 1")


@pytest.mark.parametrize(
    "block, fault",
    [
        ("```toml\nx = \n```", "line 1"),
        ("```console\n$ exit 2\n```", "exit code 2"),
        ("```console\n$ true  # exit 2\n```", "exit code 0"),
        ("```console\nls\n```", "begins with"),
        ("```bash\nls\n```", "no language 'bash'"),
    ],
)
def test_blocks_that_do_not_run_are_errors(block, fault, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(block + "\n")
    (error,) = run_page(page, tmp_path)
    assert fault in error


def test_elisions():
    """A line of dots replaces any lines, dots inside a line replace any characters."""
    assert matches(["a", "...", "b"], ["a", "b"]) and matches(["...", "b"], ["a", "a", "b"])
    assert not matches(["a", "b"], ["a", "c", "b"]) and matches(["... of 3"], ["2 of 3"])


def test_renewal_keeps_elisions():
    """New numbers replace old ones and elisions stay. A line without a counterpart is an error."""
    old, new = ["...", "force 12 N in ... s"], ["net", "force 0.012 kN in 4 s"]
    assert renew(old, new) == ["...", "force 0.012 kN in ... s"]
    with pytest.raises(BlockError, match="clearly"):
        renew(["...", "force"], ["no", "such"])
