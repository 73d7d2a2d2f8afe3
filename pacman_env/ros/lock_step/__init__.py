"""A game of nodes in one process in which simulated time advances only after all messages are handled.

The nodes are the normal ones on the real middleware; one thread runs their callbacks. Fast DDS delivers a message to
readers in the same process before ``publish`` returns. So each message is taken immediately after its publication and
waits in one queue. A step of the simulated robot starts when the queue is empty and no timer is due: the same seed
gives the same messages on any machine. The wall clock is simulated (``ros/surroundings.py``).
"""
