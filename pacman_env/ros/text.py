"""Text of other machines, made safe to show. Does not import ROS."""


def plain(text: str, longest: int) -> str:
    """Reduce text of other machines to one line without control characters, of at most ``longest`` characters."""
    words = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return words if len(words) <= longest else f"{words[: longest - 3]}..."
