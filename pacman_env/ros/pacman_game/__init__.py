"""The process of the game: referee, pellets, ghosts and goal selector as objects that call each other."""
