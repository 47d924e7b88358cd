# Goes with tenodesis-config.cmake of this folder: the version that the headers beside it state.
include(CMakePackageConfigHelpers)
foreach(part MAJOR MINOR PATCH)
  file(STRINGS ${CMAKE_CURRENT_LIST_DIR}/../include/tenodesis/version.h line REGEX "define TENODESIS_VERSION_${part} ")
  string(REGEX MATCH "[0-9]+$" ${part} "${line}")
endforeach()
set(file ${CMAKE_CURRENT_BINARY_DIR}/tenodesis-package-version.cmake)
write_basic_package_version_file(${file} VERSION ${MAJOR}.${MINOR}.${PATCH} COMPATIBILITY SameMinorVersion ARCH_INDEPENDENT)
include(${file})
