#!/bin/bash
# Compares a GPU with the CPU: results of shipped jobs, which must have the same bits, and rates of the step.
#
#     bash jobs/bench/gpu.sh          three minutes, on a machine with netfall[gpu] and a GPU
set -e
here=$(cd "$(dirname "$0")" && pwd)
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT

fewer="--set output.frames=5"
for job in saddle stadium ring_storm; do
    for device in cpu gpu; do
        TIMEFORMAT="$job $device: %R s, with all that is compiled"
        time netfall run "$here/../$job.toml" $fewer --device $device -o "$place/$job-$device.vtkhdf" --quiet
    done
    PYTHONPATH=$here/../../tests python -c '
import sys
from results import differences
lines = differences(*sys.argv[1:])
sys.exit("\n".join(lines) if lines else print("all datasets have the same bits"))
' "$place/$job-cpu.vtkhdf" "$place/$job-gpu.vtkhdf"
done
for size in 200 1000; do
    for scene in elastic all; do
        for device in cpu gpu; do
            (cd "$here" && python step.py $size $scene --rounds 3 --seconds 2 --device $device)
        done
    done
done
