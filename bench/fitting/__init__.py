"""``python -m bench.fitting``: three ways of fitting one model to the same logs, in one run.

One joint with a position servo and a weight on an arm, and a few of its numbers: those that model
M1 (dry and viscous friction) or M3 (and friction that grows with load) of Duclusaud et al. have in
common with the drive of :mod:`sim.drive.kernel`. The ways:

* **ours**: compiled batches of rollouts, Levenberg and Marquardt's way with long differences
  (:mod:`bench.diagnosis.joint.fit`);
* **bam's** (https://github.com/Rhoban/bam, on PyPI as better-actuator-models 1.0.2, Apache-2.0:
  ``bam/fit.py``, ``simulate.py``, ``process.py``, ``logs.py``, ``model.py``): CMA-ES over the whole
  box, one candidate after another, on the mean absolute error of positions; each candidate is
  stepped through the logs by a loop in Python, 5 ms a step, logs side by side in NumPy arrays;
* **MuJoCo's** (https://github.com/google-deepmind/mujoco, Apache-2.0: ``python/mujoco/sysid`` of
  4.0.0, ``_src/optimize.py`` and ``_src/residual.py``): least squares within a box by
  ``mujoco.minimize``, rollouts by ``mujoco.rollout`` on all cores; finite differences of its
  default step, 1.5e-8, and of a longer one that a caller may ask for. Friction that grows with load
  is none of the engine's: there its parameter is set from Python before every step, as the
  toolbox's ``custom_rollout`` allows and bam's ``mujoco.py`` does.

The optimiser and the rollouts of MuJoCo are the real ones; bam's are written anew after the files
named, with pycma in place of optuna's sampler (same first point, first deviation and candidates a
generation). The restarts of bam's ``bipop`` are left out: each search ends where it converges.
"""
