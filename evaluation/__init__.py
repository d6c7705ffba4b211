"""What a trained predictor is worth: on windows, live in traffic and in a closed loop; and the pages that say so."""
