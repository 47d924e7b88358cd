// Twins in lanes for processors with AVX512.

#define tenodesis tenodesis_avx512
#define TENODESIS_PROCESSOR avx512
#define TENODESIS_LANES 8
#include "engine/lane_runs.hpp"
