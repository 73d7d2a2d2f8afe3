"""Maps that come with the project: YAML and PGM pairs, drawn by ``pacman_env.world.maps.floor_plans``."""
