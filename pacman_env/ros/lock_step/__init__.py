"""A game of nodes in one process, in which simulated time advances only when every message has been handled.

The nodes are those of any other game, with their publishers, services, actions and timers in the real middleware. One
thread runs their callbacks, one after another. Fast DDS hands a message to the readers of the same process before
``publish`` returns, so each message is taken as soon as it was published, and waits in one queue, in the order of
publication. A step of the simulated robot begins when that queue is empty and no timer is due: the same seed gives the
same game, message for message, on any machine. What is not decided by the seed, the wall's clock above all, comes from
the nodes' surroundings (``ros/surroundings.py``).
"""
