"""What a run looked like: videos, stills and a viewer, drawn from the folder that it left."""
