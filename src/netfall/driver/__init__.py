"""A run from the job to the result file, and its stages: statics, member removal, modes, dynamics.

A stage is a module with
    NAME               name in checkpoints
    required(job)      whether the job needs the stage
    run(problem, context, outcomes)   computes the stage, or resumes what an earlier run began; collective
`driver.run` calls the stages in order; outcomes contains the results of earlier stages, by name. A stage that
an earlier run has finished computes and prints nothing: its outcome comes from the checkpoint.
"""
