"""The ultimate bound of the tracking errors, computed: Theorem 1 and Corollary 1 (proofs: `docs/certificate.md`)."""
