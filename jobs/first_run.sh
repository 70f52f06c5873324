#!/usr/bin/env bash
# Sets up what is missing, runs the stadium's collapse on two ranks, draws its pictures into results/, and writes a
# page there that turns and plays in any browser (without it where k3d could not be installed).
set -euo pipefail
export PATH # bash has one of its own where the environment has none, but Open MPI needs to see it
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash jobs/setup.sh
mkdir -p results
.venv/bin/mpirun -n 2 .venv/bin/netfall run jobs/stadium.toml -o results/stadium.vtkhdf
.venv/bin/netfall info results/stadium.vtkhdf
.venv/bin/netfall plot results/stadium.vtkhdf
.venv/bin/netfall view results/stadium.vtkhdf || [ $? = 2 ] # 2: without k3d
[ ! -e results/stadium.html ] || echo "Open results/stadium.html in a browser and press play."
echo "In ParaView (5.12 or newer) open results/stadium.vtkhdf as a time series."
