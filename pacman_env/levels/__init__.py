"""Arrays computed once per map, and the maps on which the games of a batch are played."""
