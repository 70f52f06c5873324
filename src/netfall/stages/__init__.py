"""Stages of a run: statics, member removal equilibria, modes, dynamics, and what belongs to one of them.

A stage is a module with three names:

    NAME                         name of the stage in checkpoints
    required(job)                returns whether the job needs the stage
    run(scene, desk, outcomes)   computes it, or resumes where an earlier run was interrupted; collective

`program.run` calls them in order. `outcomes` holds the outcomes of the stages before, by name. A stage that
an earlier run has finished computes and prints nothing: the needed parts of its outcome come from the
checkpoint.
"""
