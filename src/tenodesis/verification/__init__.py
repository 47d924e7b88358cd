"""Independent checks: the same instrument in code of others that shares nothing with the core."""
