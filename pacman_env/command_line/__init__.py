"""Provide what all commands share: errors in one line, shared options, examples in help texts."""
