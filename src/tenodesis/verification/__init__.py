"""Independent checks: the same instrument in third-party code that shares nothing with the core."""
