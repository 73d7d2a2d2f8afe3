"""Long checks of the simulator; each module is a command."""
