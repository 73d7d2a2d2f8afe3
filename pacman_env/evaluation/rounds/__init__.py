"""Play policies in the same rounds, store the rounds, and summarize them; all evaluation commands use this."""
