# Headers, C libraries, the package for find_package, and the files of pkg-config.
include(CMakePackageConfigHelpers)
include(GNUInstallDirs)

install(DIRECTORY include/tenodesis DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})

set(package ${CMAKE_INSTALL_LIBDIR}/cmake/tenodesis)
install(
  TARGETS tenodesis tenodesis_c_float tenodesis_c_double
  EXPORT tenodesis
  INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
)
install(EXPORT tenodesis NAMESPACE tenodesis:: FILE tenodesis-targets.cmake DESTINATION ${package})
# Before 1.0 a minor version may change the interface.
write_basic_package_version_file(${PROJECT_BINARY_DIR}/tenodesis-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/tenodesis-config-version.cmake DESTINATION ${package})
install(FILES cmake/installed-config.cmake DESTINATION ${package} RENAME tenodesis-config.cmake)

# Their prefix is relative to the file, so that the installed tree can be moved.
set(pkgconfig ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
cmake_path(RELATIVE_PATH CMAKE_INSTALL_PREFIX BASE_DIRECTORY ${CMAKE_INSTALL_FULL_LIBDIR}/pkgconfig OUTPUT_VARIABLE up)
if(BUILD_SHARED_LIBS)
  set(shared " -DTENODESIS_SHARED")
endif()
configure_file(cmake/tenodesis.pc.in tenodesis.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/tenodesis.pc DESTINATION ${pkgconfig})
foreach(real float double)
  configure_file(cmake/tenodesis-c.pc.in tenodesis-c-${real}.pc @ONLY)
  install(FILES ${PROJECT_BINARY_DIR}/tenodesis-c-${real}.pc DESTINATION ${pkgconfig})
endforeach()
