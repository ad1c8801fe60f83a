"""A measuring cell made of physics: a part, light, sensors that saturate."""
