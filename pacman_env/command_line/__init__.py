"""What all commands share: the frame of a command, options from dataclasses, examples in help texts."""
