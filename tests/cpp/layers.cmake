# Fails if a room includes a file of a room above it; the compiler lists what is included. The order, from below: include,
# src/engine, src/runtime, src/bindings. Of the bindings, only those of the live loop, of boards, and of the law of all
# joints, which runs in the live loop too, see the runtime.
function(check room) # files..., then ALLOWED and the folders that they may include from
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "" "FILES;ALLOWED")
  execute_process(
    COMMAND ${CXX} -std=c++20 -MM -MG -I${ROOT}/include -I${ROOT}/src ${sizes} ${arg_FILES}
    OUTPUT_VARIABLE listing RESULT_VARIABLE failed)
  if(failed)
    message(FATAL_ERROR "${CXX} could not read ${room}")
  endif()
  string(REGEX MATCHALL "${ROOT}/[^ \n\\]+" included "${listing}")
  foreach(file IN LISTS included)
    get_filename_component(file ${file} ABSOLUTE)
    file(RELATIVE_PATH file ${ROOT} ${file})
    list(TRANSFORM arg_ALLOWED REPLACE ".+" "^\\0/" OUTPUT_VARIABLE allowed)
    list(JOIN allowed "|" allowed)
    if(NOT file MATCHES "${allowed}")
      list(APPEND wrong ${file})
    endif()
  endforeach()
  if(wrong)
    list(REMOVE_DUPLICATES wrong)
    message(FATAL_ERROR "${room} includes ${wrong}; it may include from ${arg_ALLOWED} only")
  endif()
endfunction()

# joints.h is for the sizes of one instrument.
set(sizes -DTENODESIS_JOINTS=3 -DTENODESIS_TENDONS=6 -DTENODESIS_CONTACTS=3)

file(GLOB core ${ROOT}/include/tenodesis/*)
file(GLOB engine ${ROOT}/src/engine/*)
file(GLOB runtime ${ROOT}/src/runtime/*)
file(GLOB c ${ROOT}/src/c/*)
file(GLOB bindings ${ROOT}/src/bindings/*)
set(live ${ROOT}/src/bindings/runtime.cpp ${ROOT}/src/bindings/serial.cpp ${ROOT}/src/bindings/joint_control.cpp)
list(REMOVE_ITEM bindings ${live})

check(include FILES ${core} ALLOWED include)
check(src/c FILES ${c} ALLOWED include src/c)
check(src/engine FILES ${engine} ALLOWED include src/engine)
check(src/runtime FILES ${runtime} ALLOWED include src/engine src/runtime)
check(src/bindings FILES ${bindings} ALLOWED include src/engine src/bindings)
check("src/bindings of the live loop" FILES ${live} ALLOWED include src/engine src/runtime src/bindings)
