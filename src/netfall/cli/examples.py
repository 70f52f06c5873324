"""What `netfall COMMAND --help` shows at its end: commands as they are typed."""

EXAMPLES = """
netfall init roof.toml
netfall check jobs/stadium.toml -o pictures
netfall check roof.toml --set wind.speed=45 --set cable.prestress=80e3
netfall partition jobs/stadium.toml -n 8
netfall run roof.toml
mpirun -n 2 netfall run jobs/stadium.toml -o results/stadium.vtkhdf
netfall run roof.toml -o gust.vtkhdf --set wind.seed=7 --set output.checkpoint=1
netfall run roof.toml --restart roof.checkpoint-5-00004000.h5 --walltime 02:00:00
netfall info results/stadium.vtkhdf
netfall plot results/stadium.vtkhdf -o pictures
netfall plot results/dome.vtkhdf --case "snow"
netfall plot results/stadium.vtkhdf --animate --fps 25 --view 15,-40 --size 1280x720 --until 5
netfall view results/stadium.vtkhdf
netfall report results/stadium.vtkhdf -o report
netfall scale jobs/stadium.toml --ranks 1,2,4 --launcher "srun -n {ranks}"
netfall scale jobs/studies/stadium.toml --workers 1,2
netfall trade jobs/saddle.toml --vary dynamics.safety=0.8,0.4,0.2
netfall study jobs/studies/stadium.toml
netfall study jobs/studies/stadium.toml --shard 3/8
netfall study roof_study.toml -o results/roof.study.h5 --workers 16
netfall import roof.dxf -o roof
netfall import roof.dxf -o roof --unit mm --supports anchors --layers cables,edge
netfall import plan.dxf -o plan --split --tolerance 5e-3
netfall export roof.vtkhdf -o roof.dxf
netfall export roof.vtkhdf -o collapse.vtu --time 4.2
netfall export roof.vtkhdf -o roof.tcl
"""


def shown(verb: str) -> str:
    """The examples of a command as they stand below its options."""
    lines = [line for line in EXAMPLES.splitlines() if f"netfall {verb} " in line]
    title = "examples:" if len(lines) > 1 else "example:"
    return "\n".join([title, *(f"  {line}" for line in lines)]) if lines else ""
