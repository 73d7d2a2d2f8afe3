"""Training of planners. Run from the checkout: ``python -m train.ppo``."""

import os

# Threads that wait in a busy loop halve the speed as soon as anything else runs; read when torch is loaded.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
