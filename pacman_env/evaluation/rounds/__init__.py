"""Play policies on the same rounds, keep the rounds, and summarize them; every evaluation command uses this."""
