# What the packages' CMakeLists.txt share: cargo builds, and the result goes where `ros2 run` and `ros2 launch` look.
get_filename_component(TANDEM_ROOT "${CMAKE_CURRENT_LIST_DIR}/.." ABSOLUTE)

function(tandem_in_the_index)
  file(WRITE "${CMAKE_CURRENT_BINARY_DIR}/${PROJECT_NAME}" "")
  install(FILES "${CMAKE_CURRENT_BINARY_DIR}/${PROJECT_NAME}" DESTINATION share/ament_index/resource_index/packages)
  install(FILES "${CMAKE_CURRENT_SOURCE_DIR}/package.xml" DESTINATION "share/${PROJECT_NAME}")
endfunction()

# A program of this package. All programs are built at once, because cargo shares their dependencies; whoever comes second
# finds nothing left to do. The examples go with them as for the tests, which otherwise would build the dependencies once more.
function(tandem_program program)
  add_custom_target(${program} ALL
    COMMAND "${TANDEM_ROOT}/launch-scripts/setup"
    COMMAND cargo build --workspace --release --locked --bins --examples --target-dir "${TANDEM_ROOT}/target"
    WORKING_DIRECTORY "${TANDEM_ROOT}" USES_TERMINAL VERBATIM)
  install(PROGRAMS "${TANDEM_ROOT}/target/release/${program}" DESTINATION "lib/${PROJECT_NAME}")
  # The programs look for MuJoCo's library one folder above their own.
  install(DIRECTORY "${TANDEM_ROOT}/.tools/mujoco/lib/" DESTINATION lib FILES_MATCHING PATTERN "libmujoco.so*")
  tandem_in_the_index()
endfunction()

# The launch files and the configuration.
function(tandem_share)
  install(DIRECTORY "${TANDEM_ROOT}/config" DESTINATION "share/${PROJECT_NAME}")
  file(GLOB launch_files "${TANDEM_ROOT}/launch-scripts/*.launch.py")
  install(FILES ${launch_files} DESTINATION "share/${PROJECT_NAME}/launch")
  tandem_in_the_index()
endfunction()
