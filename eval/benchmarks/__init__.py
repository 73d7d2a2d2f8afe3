"""How fast it is; each module is a command."""
