"""The address of the page: the socket that it is served on, and what is printed about it, a link and a QR code."""

from __future__ import annotations

import errno
import io
import socket

from pacman_env.web.access import Tokens

WILDCARDS = ("0.0.0.0", "::")


def link(address: str, port: int, token: str = "") -> str:
    host = f"[{address}]" if ":" in address else address
    return f"http://{host}:{port}/" + (f"?token={token}" if token else "")


def own_address(family: int = socket.AF_INET) -> str | None:
    """The address by which others reach this machine, if there is one; nothing is sent."""
    there = "192.0.2.1" if family == socket.AF_INET else "2001:db8::1"  # addresses of documentation
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((there, 9))
            return str(probe.getsockname()[0])
        except OSError:
            return None


def shown_address(address: str) -> str:
    """The address of a link, for one that a server is bound to."""
    if address not in WILDCARDS:
        return address
    return own_address(socket.AF_INET6 if ":" in address else socket.AF_INET) or socket.gethostname()


def qr_code(text: str) -> str:
    """For a terminal, in half blocks; empty where segno is missing."""
    try:
        import segno
    except ImportError:
        return ""
    out = io.StringIO()
    segno.make(text, error="l", micro=False).terminal(out, compact=True, border=2)
    return out.getvalue().rstrip("\n")


def greeting(address: str, port: int, tokens: Tokens | None) -> str:
    shown = shown_address(address)
    if tokens is None:
        return f"The page: {link(shown, port)} (on this computer alone; Ctrl-C ends it)"
    operator = link(shown, port, tokens.operator)
    return (
        f"To play and run it: {operator}\n{qr_code(operator)}\n"
        f"To view, and to STOP: {link(shown, port, tokens.viewer)}\n"
        "Whoever has a link can use it, and the network sees it: no https here. Ctrl-C ends the page."
    )


def bind(host: str, port: int) -> socket.socket:
    """A bound socket; OSError says why there is none."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, UnicodeError) as error:
        raise OSError(f"{host}: no such address") from error
    bound = socket.socket(family, kind, protocol)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 17)  # a slow reader gets newer frames
        bound.bind(address)
    except OSError as error:
        bound.close()
        reasons = {
            errno.EADDRINUSE: f"port {port} of {host} is taken: another one, or 0 for any that is free",
            errno.EADDRNOTAVAIL: f"{host} is no address of this computer",
            errno.EACCES: f"port {port} of {host} may not be used: one from 1024 on, or 0 for any that is free",
        }
        raise OSError(reasons.get(error.errno or 0, f"{host}, port {port}: {error.strerror}")) from error
    return bound
