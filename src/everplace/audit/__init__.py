"""The leakage audit: what a latent code holds that it should not, and the sentences that say so."""
