"""The variational autoencoders of Oh and Eoh (2021): architecture, posterior, bounds and checkpoint.

One network (`condition_vae.ConditionVAE`) serves VAE, C-VAE and CP-VAE; they differ in which label heads they own
and in the bound they maximise (`bounds`, one function an equation).
"""
