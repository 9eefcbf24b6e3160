"""Foreign files, read strictly: archives, trees of files, .seq, videos, bags, .npy."""
