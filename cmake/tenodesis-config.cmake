# find_package(tenodesis) in the Python package or in the source tree: the targets, made from source.
if(NOT TARGET tenodesis::tenodesis)
  add_subdirectory(${CMAKE_CURRENT_LIST_DIR}/.. ${CMAKE_CURRENT_BINARY_DIR}/tenodesis-package EXCLUDE_FROM_ALL)
endif()
