#!/bin/bash
# Compares a GPU with the CPU: the stadium and 64 of its storms, which must have the same bits, storms a minute,
# and rates of the step of large nets.
#
#     bash jobs/bench/gpu.sh [STORMS]     some five minutes, on a machine with netfall[gpu] and a GPU
set -e
shopt -s inherit_errexit # a failed study has no rate
here=$(cd "$(dirname "$0")" && pwd)
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
cd "$place"
TIMEFORMAT="%R s, with all that is compiled"

same() {
    PYTHONPATH=$here/../../tests python -c '
import sys
from results import differences
lines = [line for line in differences(*sys.argv[1:]) if not line.startswith("samples/seconds")]
sys.exit("\n".join(lines) if lines else print("all datasets have the same bits"))
' "$@"
}

milliseconds() { # of a study of some storms on a device
    printf 'job = "%s/../stadium.toml"\n[vary]\n"wind.seed" = {from = 1, to = %s}\n' "$here" "$2" > "$2.toml"
    local begin
    begin=$(date +%s%N)
    netfall study "$2.toml" --device "$1" -o "$1-$2.study.h5" --quiet >&2
    echo $((($(date +%s%N) - begin) / 1000000))
}

for device in cpu gpu; do
    echo "stadium, $device"
    time netfall run "$here/../stadium.toml" --device $device -o $device.vtkhdf --quiet
done
same cpu.vtkhdf gpu.vtkhdf

rate() { # storms of the stadium a minute on a device, from 64 and from more of them
    local few more
    few=$(milliseconds "$1" 64)
    more=$(milliseconds "$1" "$2")
    echo "storms of the stadium a minute, $1: $((60000 * ($2 - 64) / (more - few)))"
}
rate cpu 512
rate gpu "${1:-4000}"
same cpu-64.study.h5 gpu-64.study.h5

cd "$here"
for size in 200 1000; do
    for device in cpu gpu; do
        python step.py $size all --rounds 3 --seconds 2 --device $device
    done
done
