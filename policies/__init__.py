"""Learning on the robosim environments: demonstrations, training and evaluation."""
