"""The page that explains a comparison: ``python -m eval.report``."""
