# Included right after project() of a message package that knows nothing of wheels, e.g. a robot's own in interfaces/extra/
# (message_wheels.py). Shows it the ROS of the build environment, and clears, once the package has been read, the include directories
# that ROS wheels export from the machine that built them and that CMake refuses.
find_package(Python3 REQUIRED COMPONENTS Interpreter Development NumPy)
execute_process(
  COMMAND "${Python3_EXECUTABLE}" -c "import ament_package, pathlib; print(pathlib.Path(ament_package.__file__).parents[4])"
  OUTPUT_VARIABLE ros_prefix OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
list(PREPEND CMAKE_PREFIX_PATH "${ros_prefix}")
set(ENV{AMENT_PREFIX_PATH} "${ros_prefix}")

# Python needs only the C type supports, and the wheels of this repository hold no C++ ones for others to build on.
macro(find_package)
  _find_package(${ARGV})
  list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "_cpp:")
endmacro()

function(clear_python_include_directories)
  get_property(imported DIRECTORY PROPERTY IMPORTED_TARGETS)
  list(FILTER imported INCLUDE REGEX "__rosidl_generator_py$")
  foreach(target IN LISTS imported)
    set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "")
  endforeach()
endfunction()
cmake_language(DEFER CALL clear_python_include_directories)
