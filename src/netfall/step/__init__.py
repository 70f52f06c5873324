"""The fast machine: one step of all particles of a rank. Touch it only with jobs/bench beside you.

`slots` puts the elements where the step reads them, `runs` finds stretches that go through vector registers,
`forces` computes forces and kick, `loop` is the time loop, and `plan` prepares what it takes.
"""
