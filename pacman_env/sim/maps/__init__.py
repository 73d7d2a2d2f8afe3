"""What is computed once per map, and which maps the games of a batch are played on."""
