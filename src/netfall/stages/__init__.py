"""The stages of a run: statics, rests, modes, dynamics, and what belongs to one of them.

A stage is a module with
    NAME               in checkpoints
    required(job)      whether the job asks for it
    run(scene, desk, outcomes)   computes it, from where an earlier run was interrupted in it; collective
`program.run` goes through them in order; outcomes are those of the stages before, by name. A stage that an
earlier run has finished computes and says nothing: what is needed of its outcome comes from the checkpoint.
"""
