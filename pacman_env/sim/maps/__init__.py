"""The arrays computed once per map, and the maps that the games of a batch are played on."""
