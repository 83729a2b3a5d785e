// The headers of OpenUSD: of an installed OpenUSD, or of the packages pxr-*-dev, which lay them out by module.
#pragma once

#if __has_include(<pxr/usd/sdf/fileFormat.h>)
#include <pxr/base/gf/matrix4d.h>
#include <pxr/base/js/json.h>
#include <pxr/base/tf/diagnostic.h>
#include <pxr/base/tf/envSetting.h>
#include <pxr/base/tf/registryManager.h>
#include <pxr/base/tf/stringUtils.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/types.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/ar/asset.h>
#include <pxr/usd/ar/resolver.h>
#include <pxr/usd/sdf/data.h>
#include <pxr/usd/sdf/fileFormat.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/types.h>
#else
#include <pxr/ar/asset.h>
#include <pxr/ar/resolver.h>
#include <pxr/gf/matrix4d.h>
#include <pxr/js/json.h>
#include <pxr/sdf/data.h>
#include <pxr/sdf/fileFormat.h>
#include <pxr/sdf/layer.h>
#include <pxr/sdf/schema.h>
#include <pxr/sdf/types.h>
#include <pxr/tf/diagnostic.h>
#include <pxr/tf/envSetting.h>
#include <pxr/tf/registryManager.h>
#include <pxr/tf/stringUtils.h>
#include <pxr/vt/array.h>
#include <pxr/vt/types.h>
#include <pxr/vt/value.h>
#endif

// The packages of 25.8 call it otherwise.
#ifndef PXR_NS
#define PXR_NS SDF_NS
#endif

namespace pdeanim_usd {
using namespace PXR_NS;
}
