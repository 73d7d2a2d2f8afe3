"""Write rounds of a policy as a data set: ``python eval/dataset.py --help``."""

from pacman_env.evaluation.dataset import main

if __name__ == "__main__":
    raise SystemExit(main())
