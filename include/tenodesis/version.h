/* The version of Tenodesis: the one place that states it. pyproject.toml, CMake and the Python module read it from
 * here. TENODESIS_VERSION of tenodesis.h is another number: that of the C interface. */
#ifndef TENODESIS_VERSION_H
#define TENODESIS_VERSION_H

/* Preprocessors compare them. NOLINTBEGIN(modernize-macro-to-enum) */
#define TENODESIS_VERSION_MAJOR 0
#define TENODESIS_VERSION_MINOR 1
#define TENODESIS_VERSION_PATCH 0
/* NOLINTEND(modernize-macro-to-enum) */

#define TENODESIS_TEXT_OF(value) #value
#define TENODESIS_DOTTED(major, minor, patch) \
  TENODESIS_TEXT_OF(major) "." TENODESIS_TEXT_OF(minor) "." TENODESIS_TEXT_OF(patch)
#define TENODESIS_VERSION_STRING \
  TENODESIS_DOTTED(TENODESIS_VERSION_MAJOR, TENODESIS_VERSION_MINOR, TENODESIS_VERSION_PATCH)

#endif
