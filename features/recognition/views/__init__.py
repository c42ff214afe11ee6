"""Description of one view: keypoints, colours, gradients and outline."""
