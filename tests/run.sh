#!/usr/bin/env bash
# Sets up what is missing, checks format, rules and types of the code, and runs all tests, those under mpirun
# included. Arguments go to pytest; -n 0 runs one test at a time.
set -euo pipefail
export PATH # bash has one of its own where the environment has none, but Open MPI needs to see it
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash jobs/setup.sh test browser
.venv/bin/netfall compile >/dev/null & # workers would compile the same kernels at the same time
.venv/bin/ruff format --check --quiet .
.venv/bin/ruff check --quiet .
.venv/bin/mypy --no-error-summary
wait $!
exec .venv/bin/python -m pytest -n 3 --no-loadscope-reorder "$@"
