# find_package(tenodesis) of an installed tree.
include(${CMAKE_CURRENT_LIST_DIR}/tenodesis-targets.cmake)

# The C libraries refer to nothing of C++: a project in C alone links them.
foreach(real float double)
  get_target_property(configurations tenodesis::c_${real} IMPORTED_CONFIGURATIONS)
  foreach(configuration IN LISTS configurations)
    set_target_properties(tenodesis::c_${real} PROPERTIES IMPORTED_LINK_INTERFACE_LANGUAGES_${configuration} C)
  endforeach()
endforeach()
