"""Who is on the network of a campaign, and what the packet filter is told; that packets are lost, its games show."""

from __future__ import annotations

import os
import socket
import sys

import pytest

from eval.campaign.network import Loss, ports_of, rules


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_process_has_the_ports_that_it_receives_on_and_sends_from() -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as two,
    ):
        one.bind(("127.0.0.1", 0))
        two.sendto(b"hello", one.getsockname())
        assert {one.getsockname()[1], two.getsockname()[1]} <= ports_of(os.getpid())
    assert ports_of(2**22 + 1) == frozenset()


def test_who_is_spared_comes_first_and_losses_concern_both_directions() -> None:
    text = rules([Loss(frozenset({7412, 7411}), 30), Loss(None, 100), Loss(frozenset(), 60)], {7401})
    assert text.splitlines()[5:] == [
        "meta l4proto != udp accept",
        "udp sport { 7401 } accept",
        "udp dport { 7401 } accept",
        "udp sport { 7411, 7412 } numgen random mod 100 < 30 drop",
        "udp dport { 7411, 7412 } numgen random mod 100 < 30 drop",
        "drop",
        "}",
        "}",
    ]
