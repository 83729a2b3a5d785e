"""What a file holds, part by part: the container, its sections with their coders, and the bases that they are for."""
