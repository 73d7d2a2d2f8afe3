"""Training of planners: in the checkout ``train``, in the package ``pacman_env.train``. Imports nothing of ``eval``."""

import os

# Threads that wait in a busy loop halve the speed as soon as anything else runs; read when torch is loaded.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
