#!/usr/bin/env bash
# Run time against error of the saddle and of the stadium: the tables of jobs/trade/README.md.
#
#   bash jobs/trade/run.sh [--ranks P]      tables (HDF5) and pictures into results/; some eight minutes, nothing else may run
#
# Stopped, it goes on where it was. The last line shows how to choose the grid.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
bash jobs/setup.sh
.venv/bin/netfall trade jobs/saddle.toml -o results "$@"
.venv/bin/netfall trade jobs/stadium.toml -o results "$@"
# .venv/bin/netfall trade jobs/stadium.toml --vary dynamics.safety=0.8,0.4,0.2 --vary dynamics.fragment_mass=0,0.05 --tolerance 0.1 -o results
