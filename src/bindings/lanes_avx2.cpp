// Twins in lanes for processors with AVX2.

#define tenodesis tenodesis_avx2
#define TENODESIS_PROCESSOR avx2
#define TENODESIS_LANES 4
#include "engine/lane_runs.hpp"
