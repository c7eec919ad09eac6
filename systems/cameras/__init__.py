"""What draws images: cameras, their lenses and sensors, and the frames that they deliver."""
