"""Stand-ins for the original's nodes: its words, topics, QoS and timings, and those of its faults that others feel.

Written against the messages alone: nothing of the game's own nodes, topics or rules is imported, so that whoever
speaks to one of these speaks to the original. Facts are from the recorded games and Milestone 3's Algorithms 1 to 8.
"""
