// The headers of OpenUSD: of an installed OpenUSD, or of the packages pxr-*-dev, which lay them out by module.
#pragma once

#if __has_include(<pxr/usd/sdf/fileFormat.h>)
#include <pxr/base/gf/half.h>
#include <pxr/base/gf/matrix4d.h>
#include <pxr/base/gf/quatd.h>
#include <pxr/base/gf/quatf.h>
#include <pxr/base/gf/quath.h>
#include <pxr/base/gf/rotation.h>
#include <pxr/base/js/json.h>
#include <pxr/base/tf/diagnostic.h>
#include <pxr/base/tf/envSetting.h>
#include <pxr/base/tf/errorMark.h>
#include <pxr/base/tf/errorTransport.h>
#include <pxr/base/tf/pathUtils.h>
#include <pxr/base/tf/registryManager.h>
#include <pxr/base/tf/stringUtils.h>
#include <pxr/base/tf/type.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/types.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/ar/asset.h>
#include <pxr/usd/ar/definePackageResolver.h>
#include <pxr/usd/ar/inMemoryAsset.h>
#include <pxr/usd/ar/packageResolver.h>
#include <pxr/usd/ar/packageUtils.h>
#include <pxr/usd/ar/resolver.h>
#ifndef PDEANIM_USD_NO_SCENES
#include <pxr/usd/pcp/cache.h>
#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/pcp/node.h>
#include <pxr/usd/pcp/primIndex.h>
#endif
#include <pxr/usd/sdf/attributeSpec.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/data.h>
#include <pxr/usd/sdf/fileFormat.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/relationshipSpec.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/types.h>
#else
#include <pxr/ar/asset.h>
#include <pxr/ar/definePackageResolver.h>
#include <pxr/ar/inMemoryAsset.h>
#include <pxr/ar/packageResolver.h>
#include <pxr/ar/packageUtils.h>
#include <pxr/ar/resolver.h>
#include <pxr/gf/half.h>
#include <pxr/gf/matrix4d.h>
#include <pxr/gf/quatd.h>
#include <pxr/gf/quatf.h>
#include <pxr/gf/quath.h>
#include <pxr/gf/rotation.h>
#include <pxr/js/json.h>
#ifndef PDEANIM_USD_NO_SCENES
#include <pxr/pcp/cache.h>
#include <pxr/pcp/layerStack.h>
#include <pxr/pcp/node.h>
#include <pxr/pcp/primIndex.h>
#endif
#include <pxr/sdf/attributeSpec.h>
#include <pxr/sdf/changeBlock.h>
#include <pxr/sdf/data.h>
#include <pxr/sdf/fileFormat.h>
#include <pxr/sdf/layer.h>
#include <pxr/sdf/primSpec.h>
#include <pxr/sdf/relationshipSpec.h>
#include <pxr/sdf/schema.h>
#include <pxr/sdf/types.h>
#include <pxr/tf/diagnostic.h>
#include <pxr/tf/envSetting.h>
#include <pxr/tf/errorMark.h>
#include <pxr/tf/errorTransport.h>
#include <pxr/tf/pathUtils.h>
#include <pxr/tf/registryManager.h>
#include <pxr/tf/stringUtils.h>
#include <pxr/tf/type.h>
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
