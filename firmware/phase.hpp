#pragma once
// What a PC shows of the compensation beside the C interface's output.

#include "tenodesis/tenodesis.h"

/// Phase of an axis's compensation, as in tenodesis/compensator.hpp; the first of a controller that was not
/// initialised.
uint32_t phase_of(const tenodesis_controller& controller, int axis);
