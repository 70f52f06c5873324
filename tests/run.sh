#!/usr/bin/env bash
# Sets up what is missing and runs all tests, those under mpirun included. Arguments go to pytest.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash jobs/setup.sh test
exec .venv/bin/python -m pytest "$@"
