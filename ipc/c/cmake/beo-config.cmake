# find_package(beo): the targets beo::beo (shared, or static where only that was installed) and beo::static.
# Found by CMake in PREFIX/share/cmake/beo, with headers and libraries below the same PREFIX.

get_filename_component(_beo_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)

find_path(BEO_INCLUDE_DIR beo.h HINTS "${_beo_prefix}/include" NO_DEFAULT_PATH)
file(GLOB _beo_library_dirs "${_beo_prefix}/lib" "${_beo_prefix}/lib64" "${_beo_prefix}/lib/*-linux-gnu*")
find_library(BEO_SHARED_LIBRARY NAMES libbeo.so HINTS ${_beo_library_dirs} NO_DEFAULT_PATH)
find_library(BEO_STATIC_LIBRARY NAMES libbeo.a HINTS ${_beo_library_dirs} NO_DEFAULT_PATH)
mark_as_advanced(BEO_INCLUDE_DIR BEO_SHARED_LIBRARY BEO_STATIC_LIBRARY)

if(NOT BEO_INCLUDE_DIR OR NOT (BEO_SHARED_LIBRARY OR BEO_STATIC_LIBRARY))
    set(beo_FOUND FALSE)
    set(beo_NOT_FOUND_MESSAGE "beo.h and libbeo must be below ${_beo_prefix}, where this file was installed: install beo again")
    return()
endif()

if(BEO_STATIC_LIBRARY AND NOT TARGET beo::static)
    find_package(Threads REQUIRED)
    add_library(beo::static STATIC IMPORTED GLOBAL)
    set_target_properties(beo::static PROPERTIES
        IMPORTED_LOCATION "${BEO_STATIC_LIBRARY}"
        INTERFACE_INCLUDE_DIRECTORIES "${BEO_INCLUDE_DIR}"
        # What a static Rust library needs of the system.
        INTERFACE_LINK_LIBRARIES "gcc_s;rt;m;${CMAKE_DL_LIBS};Threads::Threads")
endif()

if(NOT TARGET beo::beo)
    if(BEO_SHARED_LIBRARY)
        add_library(beo::beo SHARED IMPORTED)
        set_target_properties(beo::beo PROPERTIES
            IMPORTED_LOCATION "${BEO_SHARED_LIBRARY}"
            IMPORTED_SONAME libbeo.so.2
            INTERFACE_INCLUDE_DIRECTORIES "${BEO_INCLUDE_DIR}")
    else()
        add_library(beo::beo ALIAS beo::static)
    endif()
endif()
