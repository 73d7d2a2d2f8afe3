"""A game of nodes in one process, in which simulated time advances only when every message has been handled.

The nodes are those of any other game, in the real middleware; one thread runs their callbacks. Fast DDS hands a message
to the readers of the same process before ``publish`` returns, so each message is taken as soon as it was published, and
waits in one queue. A step of the simulated robot begins when that queue is empty and no timer is due: the same seed
gives the same game, message for message, on any machine. The wall's clock is simulated (``ros/surroundings.py``).
"""
